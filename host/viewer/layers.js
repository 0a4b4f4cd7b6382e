// What the map shows, each with its sign and colour there; what has a box can be left out.
const LAYERS = {
  scan: ["lidar", "·", "--scan"], candidates: ["candidates", "×", "--candidate"], bearings: ["bearings", "╌", "--bearing"],
  trails: ["trails", "∿", "--teammate"], truth: ["truth", "◌", "--truth"],
};
const shown = Object.fromEntries(Object.keys(LAYERS).map(name => [name, true]));
function sign(text, colour) {
  const made = document.createElement("b");
  made.textContent = text; made.style.color = "var(" + colour + ")"; made.setAttribute("aria-hidden", "true");
  return made;
}
function offerLayers() {
  for (const [name, [text, mark, colour]] of Object.entries(LAYERS)) {
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox"; box.checked = true; box.name = name;
    box.onchange = () => { shown[name] = box.checked; draw(); };
    label.append(box, " ", sign(mark, colour), " " + text); at("layers").append(label);
  }
  const obstacles = document.createElement("span");
  obstacles.append(sign("□", "--scan"), " obstacles"); at("layers").append(obstacles);
}
