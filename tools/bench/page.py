"""How fast a browser draws the live page, and that it draws each message it gets.

    python tools/bench/page.py

The end of a swarm20 run is told to a headless Chromium (drawing in software) 60 times per second.
Needs chromium and chromium-driver (Debian), and selenium (extra `test`).
"""

import threading
import time

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

from host.messages import Now
from host.sessions.offline.localizing import localize
from host.sessions.recordings.runs import simulate_scenario
from host.viewer.scene import Scene
from host.viewer.server import Viewer

SECONDS, RATE_HZ = 5.0, 60.0
COUNT = """
const done = arguments[0], plain = draw; let drawn = 0, spent = 0;
draw = () => {
  const begin = performance.now();
  plain(); drawn++; spent += performance.now() - begin;
};
setTimeout(() => { draw = plain; done([drawn / 5, spent / drawn]); }, 5000);
"""


def main() -> None:
    """Measure, and print frames per second and what one costs the browser."""
    run = simulate_scenario("swarm20:seconds=8,seed=1", None)
    (*_, last) = localize(run.messages, run.config)
    scene = Scene(run.config, run.config.filter.profile)
    for message in run.messages:
        scene.take(message)
    over = threading.Event()
    with Viewer(scene, port=0) as viewer:

        def tell() -> None:
            while not over.wait(1.0 / RATE_HZ):
                viewer.look(Now(last, last.time))

        teller = threading.Thread(target=tell)
        teller.start()
        options = Options()
        for argument in ("--headless=new", "--no-sandbox", "--window-size=1180,720"):
            options.add_argument(argument)
        driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
        driver.get(viewer.url)
        time.sleep(1.0)
        frames_hz, each_ms = driver.execute_async_script(COUNT)
        driver.quit()
        over.set()
        teller.join()
    print(
        f"swarm20, 1180x720: {frames_hz:.0f} frames/s of {RATE_HZ:.0f} told, {each_ms:.1f} ms each"
    )


if __name__ == "__main__":
    main()
