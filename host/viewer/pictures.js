// The cameras' pictures, only while somebody wants to see them: each comes as the blobs found in it, then the JPEG.
const cameras = new Map();  // by name: its socket
function showPictures(on) {
  at("pictures").setAttribute("aria-pressed", on);
  cameras.forEach(socket => socket.close());
  cameras.clear();
  at("cameras").replaceChildren();
  if (on) scene.pictures.forEach(openCamera);
}
function openCamera(name) {
  const figure = document.createElement("figure"), caption = document.createElement("figcaption");
  const canvas = document.createElement("canvas");
  canvas.setAttribute("role", "img");
  figure.append(canvas, caption); at("cameras").append(figure);
  const socket = new WebSocket("ws://" + location.host + "/pictures/" + name + location.search);
  socket.binaryType = "arraybuffer";
  cameras.set(name, socket);
  let found = null;
  socket.onmessage = async ({data}) => {
    if (typeof data === "string") { found = JSON.parse(data); return; }
    const {blobs, time} = found;
    const picture = await createImageBitmap(new Blob([data], {type: "image/jpeg"})).catch(() => null);
    if (!picture) return;  // damaged on its way from the camera
    drawPicture(canvas, picture, blobs);
    caption.textContent = name + ": " + (blobs.length ? blobs.map(sayBlob).join(", ") : "no strip");
    canvas.setAttribute("aria-label", "picture of the " + caption.textContent);
    canvas.dataset.time = time;
  };
  socket.onclose = () => setTimeout(() => {  // the run ended, or begins anew
    if (cameras.get(name) === socket) { figure.remove(); openCamera(name); }
  }, 1000);
}
const sayBlob = ({direction, range}) =>
  (direction * 180 / Math.PI).toFixed(0) + "°" + (range === null ? "" : " " + range.toFixed(1) + " m");
function drawPicture(canvas, picture, blobs) {
  canvas.width = picture.width; canvas.height = picture.height;
  const brush = canvas.getContext("2d"), size = picture.width / 40;
  brush.drawImage(picture, 0, 0);
  for (const [colour, width] of [["#000", 6], ["#fff", 3]]) {
    brush.strokeStyle = colour; brush.lineWidth = width * picture.width / 400;
    for (const {x, y} of blobs) brush.strokeRect(x - size, y - size, 2 * size, 2 * size);
  }
}
at("pictures").onclick = () => { if (scene) showPictures(!cameras.size); };
