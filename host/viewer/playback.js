// In a replay: where it is, and what is asked of it. A run has no time bar.
let player = null;
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16];
function ask(wish) {
  if (player && player.readyState === WebSocket.OPEN) player.send(JSON.stringify(wish));
}
function tellPlayback(playback) {
  at("playback").hidden = !playback;
  at("pause").hidden = !!playback;
  if (!playback) return;
  if (!player) {
    player = new WebSocket("ws://" + location.host + "/playback" + location.search);
    player.onclose = () => { player = null; };
  }
  const bar = at("when"), {begin, end, now, speed, playing} = playback;
  bar.max = end - begin;
  if (document.activeElement !== bar || !bar.dataset.held) bar.value = now - begin;
  const text = sayTime(now - begin) + " of " + sayTime(end - begin);
  at("clock").textContent = text;
  bar.setAttribute("aria-valuetext", text);
  at("play").textContent = playing ? "pause" : "play";
  at("play").dataset.playing = playing;
  at("speed").value = SPEEDS.reduce((best, each) => Math.abs(each - speed) < Math.abs(best - speed) ? each : best);
}
const sayTime = seconds => Math.floor(seconds / 60) + ":" + (seconds % 60).toFixed(1).padStart(4, "0");
const togglePlay = () => ask({do: at("play").dataset.playing === "true" ? "pause" : "play"});
at("play").onclick = togglePlay;
at("step").onclick = () => ask({do: "step"});
at("when").onpointerdown = () => { at("when").dataset.held = "yes"; };
at("when").onchange = event => {
  delete event.target.dataset.held;
  ask({do: "seek", to: scene.playback.begin + Number(event.target.value)});
};
at("speed").onchange = event => ask({do: "speed", to: Number(event.target.value)});
at("speed").append(...SPEEDS.map(speed => new Option(speed + " ×", speed)));
