const TRAIL_S = 12, STRIP_S = 60, LOST_MS = 1500, OLD_S = 1, SILENT_S = 0.6;
const at = id => document.getElementById(id);
const map = at("map"), pen = map.getContext("2d");
// x, y: pixels by which the robot is off the middle; scale: pixels a metre.
const view = {x: 0, y: 0, scale: 120, northUp: false, paused: false, measuring: false, ruler: []};
let scene = null, heard = 0;
const trails = new Map(), history = [];
const colours = {};

function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["ground", "ink", "quiet", "grid", "scan", "teammate", "truth", "candidate", "bearing"])
    colours[name] = style.getPropertyValue("--" + name).trim();
}

// Frames: the robot's (x ahead, y left), the odometry's (of `pose`), and pixels of the page.
const turn = () => view.northUp ? scene.pose.heading : 0;
function toPixel([x, y]) {
  const c = Math.cos(turn()), s = Math.sin(turn());
  const ahead = c * x - s * y, left = s * x + c * y;
  return [map.clientWidth / 2 + view.x - left * view.scale, map.clientHeight / 2 + view.y - ahead * view.scale];
}
function toRobot([px, py]) {
  const left = -(px - map.clientWidth / 2 - view.x) / view.scale, ahead = -(py - map.clientHeight / 2 - view.y) / view.scale;
  const c = Math.cos(turn()), s = Math.sin(turn());
  return [c * ahead + s * left, -s * ahead + c * left];
}
function toOdometry(x, y) {
  const {x: x0, y: y0, heading: h} = scene.pose;
  return [x0 + Math.cos(h) * x - Math.sin(h) * y, y0 + Math.sin(h) * x + Math.cos(h) * y];
}
function fromOdometry([x, y]) {
  const {x: x0, y: y0, heading: h} = scene.pose, dx = x - x0, dy = y - y0;
  return [Math.cos(h) * dx + Math.sin(h) * dy, -Math.sin(h) * dx + Math.cos(h) * dy];
}

function connect() {
  const socket = new WebSocket("ws://" + location.host + "/stream" + location.search);
  socket.onmessage = event => {
    heard = performance.now();
    if (view.paused) return;
    scene = JSON.parse(event.data);
    remember();
    requestAnimationFrame(draw);
  };
  socket.onclose = () => setTimeout(connect, 1000);
}

function remember() {
  for (const each of scene.estimates) {
    if (!trails.has(each.label)) trails.set(each.label, []);
    trails.get(each.label).push([scene.time, ...toOdometry(each.x, each.y)]);
  }
  for (const [label, places] of trails) {
    while (places.length && places[0][0] < scene.time - TRAIL_S) places.shift();
    if (!places.length) trails.delete(label);
  }
  const weight = scene.estimates.reduce((sum, each) => sum + each.weight, 0);
  history.push([scene.time, scene.estimates.length, weight, 1000 * (scene.time - scene.measured)]);
  while (history.length && history[0][0] < scene.time - STRIP_S) history.shift();
}

function draw() {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.round(map.clientWidth * ratio), height = Math.round(map.clientHeight * ratio);
  if (map.width !== width || map.height !== height) { map.width = width; map.height = height; }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, map.clientWidth, map.clientHeight);
  if (!scene) return;
  drawGrid();
  drawBlind();
  if (shown.scan) drawScan();
  if (shown.bearings) scene.bearings.forEach(drawBearings);
  if (shown.candidates) scene.candidates.forEach(drawCandidate);
  scene.obstacles.forEach(drawObstacle);
  if (shown.trails) trails.forEach(drawTrail);
  if (shown.truth && scene.truth) scene.truth.forEach(drawTruth);
  scene.estimates.forEach(drawTeammate);
  drawRobot();
  drawRuler();
  tell();
}

function stroke(colour, width = 1, dash = []) {
  pen.strokeStyle = colours[colour]; pen.lineWidth = width; pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]);
}
function circle([x, y], radius) { pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); }
function line(from, to) { pen.beginPath(); pen.moveTo(...from); pen.lineTo(...to); }
function words(text, [x, y], colour) {
  pen.font = "12px system-ui, sans-serif";
  pen.lineWidth = 3; pen.strokeStyle = colours.ground; pen.strokeText(text, x, y);
  pen.fillStyle = colours[colour]; pen.fillText(text, x, y);
}

function drawGrid() {
  const middle = toPixel([0, 0]);
  for (let metres = 1; metres <= 10; metres++) {
    circle(middle, metres * view.scale); stroke("grid");
    if (metres * view.scale > 25) words(metres + " m", [middle[0] + 4, middle[1] - metres * view.scale - 3], "quiet");
  }
}
function drawBlind() {
  for (const {centre, width} of scene.blind) {
    const [a, b] = [centre - width / 2, centre + width / 2].map(angle => toPixel([3 * Math.cos(angle), 3 * Math.sin(angle)]));
    pen.beginPath(); pen.moveTo(...toPixel([0, 0])); pen.lineTo(...a); pen.lineTo(...b); pen.closePath();
    pen.globalAlpha = .35; pen.fillStyle = colours.grid; pen.fill(); pen.globalAlpha = 1;
  }
}
function drawScan() {
  pen.fillStyle = colours.scan;
  for (const point of scene.scan) { const [x, y] = toPixel(point); pen.fillRect(x - 1, y - 1, 2, 2); }
}
function drawBearings({x, y, directions}) {
  pen.globalAlpha = .6;
  for (const angle of directions) {
    line(toPixel([x, y]), toPixel([x + 4 * Math.cos(angle), y + 4 * Math.sin(angle)])); stroke("bearing", 1, [6, 4]);
  }
  pen.globalAlpha = 1;
}
function drawCandidate(place) {
  const [x, y] = toPixel(place);
  line([x - 4, y - 4], [x + 4, y + 4]); stroke("candidate", 1.5);
  line([x - 4, y + 4], [x + 4, y - 4]); stroke("candidate", 1.5);
}
function drawObstacle({x, y}) {
  const [px, py] = toPixel([x, y]), half = Math.max(4, .05 * view.scale);
  pen.beginPath(); pen.rect(px - half, py - half, 2 * half, 2 * half); stroke("quiet", 1.5);
}
function drawTrail(places) {
  pen.beginPath();
  places.forEach(([, x, y], k) => pen[k ? "lineTo" : "moveTo"](...toPixel(fromOdometry([x, y]))));
  pen.globalAlpha = .45; stroke("teammate", 2); pen.globalAlpha = 1;
}
function drawTruth({x, y}) { circle(toPixel([x, y]), Math.max(5, .055 * view.scale)); stroke("truth", 1.5, [3, 2]); }
function drawTeammate(each) {
  const place = toPixel([each.x, each.y]);
  const [major, minor] = each.sigmas.map(sigma => Math.max(2 * sigma * view.scale, 2));
  const angle = -Math.PI / 2 - each.angle - turn();
  pen.globalAlpha = each.age > OLD_S ? .4 : 1;
  pen.beginPath();
  pen.ellipse(...place, major, minor, angle, 0, 2 * Math.PI);
  pen.fillStyle = colours.teammate;
  const alpha = pen.globalAlpha; pen.globalAlpha *= .18; pen.fill(); pen.globalAlpha = alpha;
  stroke("teammate", 1.5);
  circle(place, 3); pen.fill();
  pen.globalAlpha = 1;
  if (each.name) {
    const ahead = [each.x + .15 * Math.cos(each.name.heading), each.y + .15 * Math.sin(each.name.heading)];
    line(place, toPixel(ahead)); stroke("teammate", 2);
  }
  const text = called(each) + "  " + Math.hypot(each.x, each.y).toFixed(2) + " m";
  const half = Math.hypot(major * Math.cos(angle), minor * Math.sin(angle)) + 4, width = pen.measureText(text).width;
  const beyond = place[0] + half + width > map.clientWidth && place[0] < map.clientWidth;
  words(text, [place[0] + (beyond ? -half - width : half), place[1] - 4], "ink");
}
// A teammate's label or, where it is recognized by the odometry that it sends, who it is.
function called({label, name}) { return name ? label + " robot " + name.robot + (name.probability > .9 ? "" : "?") : label; }
function drawRobot() {
  const corners = [[.1, 0], [-.07, .07], [-.04, 0], [-.07, -.07]].map(toPixel);
  pen.beginPath(); corners.forEach((corner, k) => pen[k ? "lineTo" : "moveTo"](...corner)); pen.closePath();
  pen.fillStyle = colours.ink; pen.fill();
}
function drawRuler() {
  const [from, to] = view.ruler;
  at("ruler").textContent = view.measuring ? "click two places" : "";
  if (!to) return;
  line(toPixel(from), toPixel(to)); stroke("ink", 1.5);
  at("ruler").textContent = Math.hypot(to[0] - from[0], to[1] - from[1]).toFixed(3) + " m";
}

// What stands beside the map says the same in words, for print and for screen readers.
function tell() {
  at("robot").textContent = "swarmloc  " + scene.robot;
  at("about").textContent = "filter " + scene.filter;
  tellPlayback(scene.playback);
  at("seen").hidden = !scene.pictures.length;
  at("count").textContent = scene.estimates.length + (scene.truth ? " (true, within 2 m: " + scene.truth.filter(t => Math.hypot(t.x, t.y) <= 2).length + ")" : "");
  at("error").hidden = !scene.truth;
  const rows = at("teammates"), sorted = [...scene.estimates].sort((a, b) => a.label - b.label);
  while (rows.rows.length > sorted.length) rows.deleteRow(-1);
  sorted.forEach((each, k) => {
    const row = rows.rows[k] || rows.insertRow();
    row.className = each.age > OLD_S ? "old" : "";
    const sigma = 1000 * Math.hypot(...each.sigmas) / Math.SQRT2;
    const cells = [called(each), Math.hypot(each.x, each.y).toFixed(2), (Math.atan2(each.y, each.x) * 180 / Math.PI).toFixed(0),
      sigma.toFixed(0), each.weight.toFixed(2), each.age.toFixed(1)];
    if (scene.truth) cells.push(error(each));
    while (row.cells.length > cells.length) row.deleteCell(-1);
    cells.forEach((text, column) => say(row.cells[column] || row.insertCell(), text));
  });
  const devices = JSON.stringify(scene.devices.map(({name, ok, reason}) => [name, ok, reason]));
  if (at("devices").dataset.told !== devices) at("devices").replaceChildren(...scene.devices.flatMap(({name, ok, reason}) => {
    const term = document.createElement("dt"), detail = document.createElement("dd");
    term.textContent = name; detail.textContent = (ok ? "ok: " : "FAIL: ") + reason.trim().split("\n").join("; ");
    detail.className = ok ? "" : "bad";
    return [term, detail];
  }));
  at("devices").dataset.told = devices;
  strips.forEach(drawStrip);
  sayState();
}
// What stays the same is left alone, so that who reads it aloud or selects it is not interrupted.
function say(element, text) { if (element.textContent !== String(text)) element.textContent = text; }
function error({x, y}) {
  const nearest = Math.min(...scene.truth.map(t => Math.hypot(t.x - x, t.y - y)));
  return nearest < .5 ? (1000 * nearest).toFixed(0) : "false";
}
function sayState() {
  const silent = scene ? scene.time - scene.measured : 0;
  const lost = performance.now() - heard > LOST_MS;
  const text = lost ? (heard ? "connection lost" : "connecting") : view.paused ? "paused"
    : scene.playback ? "recorded" : silent > SILENT_S ? "nothing measured for " + silent.toFixed(1) + " s" : "live";
  if (at("state").textContent !== text) at("state").textContent = text;
  at("state").className = ["live", "paused", "recorded"].includes(text) ? "" : "bad";
}

const strips = [["teammates", 1, 0], ["total weight", 2, 1], ["ms since a reading", 3, 0]].map(([name, column, decimals]) => {
  const figure = document.createElement("figure"), caption = document.createElement("figcaption");
  const canvas = document.createElement("canvas"), label = document.createElement("span"), value = document.createElement("span");
  label.textContent = name; canvas.setAttribute("aria-hidden", "true");
  caption.append(label, value); figure.append(caption, canvas); at("strips").append(figure);
  return {canvas, value, column, decimals};
});
function drawStrip({canvas, value, column, decimals}) {
  const ratio = window.devicePixelRatio || 1, strip = canvas.getContext("2d");
  const width = canvas.width = canvas.clientWidth * ratio, height = canvas.height = canvas.clientHeight * ratio;
  const top = Math.max(1, ...history.map(row => row[column]));
  value.textContent = history.at(-1)[column].toFixed(decimals) + ", at most " + top.toFixed(decimals);
  strip.beginPath();
  history.forEach((row, k) => strip[k ? "lineTo" : "moveTo"](
    width * (1 - (scene.time - row[0]) / STRIP_S), (height - 2 * ratio) * (1 - row[column] / top) + ratio));
  strip.strokeStyle = colours.teammate; strip.lineWidth = 1.5 * ratio; strip.stroke();
}

function zoom(factor, [x, y]) {
  const scale = Math.min(2000, Math.max(15, view.scale * factor)), change = scale / view.scale;
  view.x = (view.x + map.clientWidth / 2 - x) * change + x - map.clientWidth / 2;
  view.y = (view.y + map.clientHeight / 2 - y) * change + y - map.clientHeight / 2;
  view.scale = scale;
  draw();
}
function fit() {
  view.x = view.y = 0;
  view.scale = Math.min(map.clientWidth, map.clientHeight) / 5;  // 2 m around, and a border
  draw();
}
function press(id, name) {
  view[name] = !view[name];
  at(id).setAttribute("aria-pressed", view[name]);
  if (name === "measuring") view.ruler = [];
  draw(); sayState();
}
at("pause").onclick = () => press("pause", "paused");
at("north").onclick = () => press("north", "northUp");
at("measure").onclick = () => press("measure", "measuring");
at("fit").onclick = fit;
const keys = {" ": () => scene && scene.playback ? togglePlay() : press("pause", "paused"), ".": () => ask({do: "step"}), n: () => press("north", "northUp"), m: () => press("measure", "measuring"), f: fit, p: () => at("pictures").click(),
  "+": () => zoom(1.25, centre()), "-": () => zoom(.8, centre()),
  ArrowLeft: () => pan(40, 0), ArrowRight: () => pan(-40, 0), ArrowUp: () => pan(0, 40), ArrowDown: () => pan(0, -40)};
const centre = () => [map.clientWidth / 2, map.clientHeight / 2];
function pan(x, y) { view.x += x; view.y += y; draw(); }
document.addEventListener("keydown", event => {
  const plain = !event.ctrlKey && !event.metaKey && !event.altKey;
  if (plain && keys[event.key] && !["BUTTON", "INPUT", "SELECT"].includes(event.target.tagName)) { keys[event.key](); event.preventDefault(); }
});

// One finger or the mouse pans, two pinch.
const fingers = new Map();
map.onpointerdown = event => {
  map.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  if (view.measuring && scene) { view.ruler = [...(view.ruler.length < 2 ? view.ruler : []), toRobot([event.offsetX, event.offsetY])]; draw(); }
};
map.onpointermove = event => {
  const before = fingers.get(event.pointerId), now = [event.offsetX, event.offsetY];
  if (!before) return;
  const other = [...fingers].find(([id]) => id !== event.pointerId);
  fingers.set(event.pointerId, now);
  if (other) {
    const distance = place => Math.hypot(place[0] - other[1][0], place[1] - other[1][1]);
    zoom(distance(now) / Math.max(1, distance(before)), other[1]);
  } else if (!view.measuring) pan(now[0] - before[0], now[1] - before[1]);
};
map.onpointerup = map.onpointercancel = event => fingers.delete(event.pointerId);
map.addEventListener("wheel", event => { zoom(Math.exp(-event.deltaY / 500), [event.offsetX, event.offsetY]); event.preventDefault(); }, {passive: false});

offerLayers();
for (const media of ["(prefers-color-scheme: dark)", "print"])
  matchMedia(media).addEventListener("change", () => { readColours(); draw(); });
window.addEventListener("resize", draw);
setInterval(sayState, 500);
readColours();
fit();
connect();
