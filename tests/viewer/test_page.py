"""The page in a real browser: what it draws, what it says, and that it asks nobody else."""

import dataclasses
import json
import math
import re
import subprocess
import sys
import time
import urllib.parse
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.config import RobotConfig
from host.messages import Bearings, Picture
from host.recording.log import Recorder, RecordingHeader
from host.sessions.recordings.runs import simulated
from host.simulation.world.scenarios import parse_scenario
from tests.viewer import scenes

DOC = (Path(__file__).resolve().parents[2] / "docs" / "stream.md").read_text()
# Middle of all pixels that something changes, each by how much it does (so that smoothed edges
# count), in CSS pixels from the middle of the map.
CENTROID = """
const all = () => { draw(); return pen.getImageData(0, 0, map.width, map.height).data; };
const what = arguments[0], estimates = scene.estimates;
if (what === "teammate") scene.estimates = [];
const before = all();
if (what === "teammate") scene.estimates = estimates; else shown[what] = true;
const after = all(), ratio = map.width / map.clientWidth;
if (what !== "teammate") shown[what] = false;
let sum = 0, x = 0, y = 0;
for (let k = 0; k < after.length; k += 4) {
  const place = k / 4, column = place % map.width, row = Math.floor(place / map.width);
  let weight = 0;
  for (let j = 0; j < 4; j++) weight += Math.abs(after[k + j] - before[k + j]);
  const off = Math.hypot(column - arguments[1][0] * ratio, row - arguments[1][1] * ratio);
  if (off < 5 * ratio) { sum += weight; x += weight * (column + .5); y += weight * (row + .5); }
}
return [sum, x / sum / ratio - map.clientWidth / 2, y / sum / ratio - map.clientHeight / 2];
"""
SCENES = [
    ((1.0, 0.5), 0.0, False),
    ((-1.2, -0.3), 0.9, False),
    ((0.7, -1.1), 2.0, True),
]


@pytest.mark.parametrize(("place", "heading", "north_up"), SCENES)
def test_what_is_drawn_stands_where_the_stream_says(served, browser, place, heading, north_up):
    steps = [scenes.a_step(0.9), scenes.a_step(1.0, dpsi=heading)]
    known = scenes.now(1.0, place, sigma=0.001)
    other = (-place[1], place[0])  # where a scan's only return is, and its only candidate
    running = served(*steps, scenes.a_scan(1.0, other), scenes.candidates(1.0, other), now=known)
    browser.driver.get(running.viewer.url)
    browser.wait_for("scene && scene.estimates.length === 1")
    if north_up:
        browser.driver.find_element("id", "north").click()
    for name in ("scan", "candidates", "bearings", "trails", "truth"):
        browser.driver.find_element("name", name).click()
    scale = browser.driver.execute_script("return view.scale")
    middle = browser.driver.execute_script("return [map.clientWidth / 2, map.clientHeight / 2]")
    angle = heading if north_up else 0.0
    for what, (forward, sideways) in (("teammate", place), ("candidates", other), ("scan", other)):
        ahead = math.cos(angle) * forward - math.sin(angle) * sideways
        left = math.sin(angle) * forward + math.cos(angle) * sideways
        expected = [-scale * left, -scale * ahead]
        near = [middle[0] + expected[0], middle[1] + expected[1]]
        changed, *drawn = browser.driver.execute_script(CENTROID, what, near)
        assert changed > 300, what
        assert drawn == pytest.approx(expected, abs=1.0), what


def test_it_says_in_words_what_it_draws(served, browser):
    running = served(
        scenes.health(ok=False), now=scenes.now(1.0, (1.0, 0.5), (0.0, -2.0), truth=True)
    )
    browser.driver.get(running.viewer.url)
    browser.wait_for("document.querySelectorAll('#teammates tr').length === 2")
    rows = browser.driver.execute_script(
        "return [...document.querySelectorAll('#teammates tr')].map("
        "row => [...row.cells].map(cell => cell.textContent))"
    )
    assert rows[0] == ["1", "1.12", "27", "30", "0.90", "0.1", "0"]
    assert rows[1][:3] == ["2", "2.00", "-90"]
    said = browser.driver.execute_script("return document.getElementById('devices').textContent")
    assert said == "lidarFAIL: scanning"
    browser.wait_for("document.getElementById('state').textContent === 'live'")


def test_pause_zoom_and_measure_by_keyboard_and_pointer(served, browser):
    running = served(now=scenes.now(1.0, (1.0, 0.5)))
    browser.driver.get(running.viewer.url)
    browser.wait_for("scene")
    body = browser.driver.find_element("tag name", "body")
    body.send_keys(" ")
    browser.wait_for("document.getElementById('state').textContent === 'paused'")
    running.now = scenes.now(2.0, (1.0, 0.5), (1.0, 1.0))
    assert browser.driver.execute_script("return scene.estimates.length") == 1
    body.send_keys(" ")
    browser.wait_for("scene.estimates.length === 2")
    before = browser.driver.execute_script("return view.scale")
    body.send_keys("+")
    assert browser.driver.execute_script("return view.scale") == pytest.approx(1.25 * before)
    body.send_keys("fm")
    browser.driver.execute_script(
        """for (const place of [[0, 0], [1, 0]]) {
             const [offsetX, offsetY] = toPixel(place);
             map.setPointerCapture = () => {}; map.onpointerdown({pointerId: 1, offsetX, offsetY});
             map.onpointerup({pointerId: 1}); }"""
    )
    assert browser.driver.find_element("id", "ruler").text == "1.000 m"


def test_when_the_run_ends_it_says_so(served, browser):
    running = served()
    browser.driver.get(running.viewer.url)
    browser.wait_for("document.getElementById('state').textContent === 'live'")
    running.stop()
    browser.wait_for("document.getElementById('state').textContent === 'connection lost'")


def test_the_javascript_of_the_documentation_runs(served, browser):
    (example,) = re.findall(r"```javascript\n(.*?)```", DOC, re.DOTALL)
    running = served()
    browser.driver.get(running.viewer.url)
    browser.driver.execute_script(
        "window.said = []; console.log = text => said.push(text);"
        + example.replace("ws://127.0.0.1:8737/stream", running.stream)
    )
    assert browser.wait_for("said[0]") == "1: 1.00 0.50 m, 0.1 s ago"


def test_teammates_of_a_run_move_on_it_and_it_asks_nobody_else(browser):
    command = [sys.executable, "-u", "-c", "from host.cli.main import main; main()"]
    arguments = ["run", "--simulate", "arena4", "--seconds", "40", "--view", "127.0.0.1:0"]
    with subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, text=True) as run:
        try:
            (url,) = next(filter(None, (re.findall(r"http://\S+", line) for line in run.stdout)))
            browser.driver.get(url)
            first = browser.wait_for("scene && scene.estimates.length && scene.estimates[0].x")
            browser.wait_for(f"scene.estimates.length && scene.estimates[0].x !== {first}")
            browser.wait_for("scene.scan.length > 100")
        finally:
            run.terminate()
            run.communicate()
    asked = [
        json.loads(entry["message"])["message"] for entry in browser.driver.get_log("performance")
    ]
    hosts = {
        urllib.parse.urlsplit(event["params"]["request"]["url"]).hostname
        for event in asked
        if event["method"] == "Network.requestWillBeSent"
    }
    assert hosts <= {"127.0.0.1", None}


def test_pictures_are_drawn_with_their_blobs_while_they_are_wanted(served, browser):
    grey = np.full((240, 320, 3), 90, dtype=np.uint8)
    jpeg = cv2.imencode(".jpg", grey)[1].tobytes()
    seen = dataclasses.replace(
        scenes.bearings(1.0, 0.5), ranges=np.array([1.5]), pixels=np.array([[100.0, 50.0]])
    )
    running = served(pictures=["front", "rear"], picture=(jpeg, seen))
    browser.driver.get(running.viewer.url)
    browser.wait_for("scene && !document.getElementById('seen').hidden")
    assert not running.viewer.asked("front")
    browser.driver.find_element("id", "pictures").click()
    said = browser.wait_for("document.querySelector('#cameras figcaption').textContent")
    assert said == "front: 29° 1.5 m"
    # The square around the blob is white, its middle and the rest are as in the picture.
    colours = browser.driver.execute_script(
        "const {data} = document.querySelector('#cameras canvas').getContext('2d')"
        ".getImageData(0, 0, 320, 240);"
        "return [[92, 50], [100, 50], [200, 200]].map(([x, y]) => data[4 * (320 * y + x)])"
    )
    assert colours[0] > 200
    assert colours[1:] == pytest.approx([90, 90], abs=4)
    browser.driver.find_element("id", "pictures").click()
    browser.wait_for("!document.querySelector('#cameras canvas')")
    end = time.monotonic() + 30.0
    while running.viewer.asked("front"):
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """The address of a page on which eight recorded seconds are replayed, and the run's output."""
    path = tmp_path_factory.mktemp("replay") / "short.mcap"
    simulation, messages = simulated(parse_scenario("arena4:seconds=8,seed=2"), RobotConfig())
    jpeg = cv2.imencode(".jpg", np.full((30, 40, 3), 90, dtype=np.uint8))[1].tobytes()
    with Recorder(path, RecordingHeader(simulation.config, "lidar+camera")) as recorder:
        for message in messages:
            if isinstance(message, Bearings):
                message = dataclasses.replace(message, camera="front")
                recorder.write(Picture(message.time, "front", jpeg))
            recorder.write(message)
    command = [sys.executable, "-u", "-m", "host.cli", "replay", str(path)]
    # So slowly that it is not over before a busy computer's browser shows it.
    replay = [*command, "--view", "127.0.0.1:0", "--speed", "0.5"]
    with subprocess.Popen(replay, stdout=subprocess.PIPE, text=True) as run:
        yield next(filter(None, (re.findall(r"http://\S+", line) for line in run.stdout)))[0]
        run.terminate()
        rest = run.communicate()[0]
    assert run.returncode == 0, rest
    assert "Summary" in rest


def test_a_recording_is_played_paused_stepped_and_sought_on_the_page(replayed, browser):
    driver = browser.driver
    driver.get(replayed)
    browser.wait_for("scene && scene.estimates.length && !at('playback').hidden")
    assert browser.wait_for("at('state').textContent") == "recorded"
    driver.find_element("tag name", "body").send_keys(" ")
    browser.wait_for("!scene.playback.playing && at('play').textContent === 'play'")
    before = driver.execute_script("return scene.playback.now")
    driver.find_element("id", "pictures").click()  # those of where it stands
    shown = browser.wait_for("document.querySelector('#cameras canvas').dataset.time")
    assert before - 0.5 < float(shown) < before
    driver.find_element("id", "step").click()
    stepped = browser.wait_for(f"scene.playback.now > {before} && scene.playback.now")
    assert stepped < before + 0.5
    seek = "const bar = at('when'); bar.value = {}; bar.onchange({{target: bar}})"
    driver.execute_script(seek.format(6.0))
    browser.wait_for("scene.playback.now - scene.playback.begin > 5.9 && scene.scan.length > 100")
    driver.execute_script(seek.format(2.0))
    browser.wait_for("Math.abs(scene.playback.now - scene.playback.begin - 2) < 0.1")
    assert driver.find_element("id", "clock").text.startswith("0:0")
    assert not browser.driver.execute_script("return scene.playback.playing")
    driver.execute_script("at('speed').value = 16; at('speed').onchange({target: at('speed')})")
    driver.find_element("id", "play").click()
    browser.wait_for("scene.playback.end - scene.playback.now < 0.05 && !scene.playback.playing")
