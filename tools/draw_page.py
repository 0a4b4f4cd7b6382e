"""Draw docs/page-*.png: the page of a simulated run and of replays, on a laptop and a phone.

    python -m tools.draw_page

Needs chromium and chromium-driver (Debian), and selenium (extra `test`).
"""

import contextlib
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

DOCS = Path(__file__).resolve().parents[1] / "docs"
SWARMLOC = str(Path(sys.executable).with_name("swarmloc"))
RUN = ["run", "--simulate", "furnished6:seed=4", "--seconds", "90", "--view", "127.0.0.1:0"]
SETTLE_S = 20.0  # trails are long by then
# What is replayed has rendered pictures, which are searched, recorded and shown again.
RECORD = ["run", "--simulate", "furnished6:seed=4,rendered=1", "--seconds", "20", "--view", "none"]
PICTURES_S = 5.0
# Simulated offline, so that a busy computer does not disturb it.
SWARM = ["simulate", "swarm20:side_m=5,posts=4,boxes=3,seed=4,seconds=26"]
SWARM_S = 18.0  # of the replay
# Width, height (CSS pixels), pixels a CSS pixel, and the scheme, of each picture.
PICTURES = {
    "laptop-light": (1180, 720, 1, "light"),
    "laptop-dark": (1180, 720, 1, "dark"),
    "phone-light": (390, 844, 2, "light"),
    "phone-dark": (390, 844, 2, "dark"),
}
CROWDED = {"swarm": (1180, 720, 1, "light")}
REPLAYED = {"replay-laptop": (1180, 800, 1, "light"), "replay-phone": (390, 844, 2, "light")}


def main() -> None:
    """Draw a run, a replay with pictures, and a replay of a swarm."""
    with page_of(RUN) as page:
        time.sleep(SETTLE_S)
        draw(page, PICTURES)
    with tempfile.TemporaryDirectory() as folder:
        recording = f"{folder}/run.mcap"
        subprocess.run([SWARMLOC, *RECORD, "--record", recording, "--pictures"], check=True)
        with page_of(["replay", recording, "--view", "127.0.0.1:0"]) as page:
            time.sleep(SETTLE_S / 2.0)
            page.find_element("id", "pictures").click()
            time.sleep(PICTURES_S)
            draw(page, REPLAYED)
        recording = f"{folder}/swarm.mcap"
        subprocess.run([SWARMLOC, *SWARM, "--output", recording], check=True)
        with page_of(["replay", recording, "--view", "127.0.0.1:0"]) as page:
            time.sleep(SWARM_S)
            draw(page, CROWDED)


@contextlib.contextmanager
def page_of(command: list[str]) -> Iterator[webdriver.Chrome]:
    """A browser with the page that a command serves."""
    options = Options()
    for argument in ("--headless=new", "--no-sandbox", "--hide-scrollbars"):
        options.add_argument(argument)
    with (
        subprocess.Popen([SWARMLOC, *command], stdout=subprocess.PIPE, text=True) as served,
        contextlib.ExitStack() as ended,  # first, on every path: Popen waits for the program
    ):
        ended.callback(served.terminate)
        assert served.stdout is not None
        (url,) = next(filter(None, (re.findall(r"http://\S+", line) for line in served.stdout)))
        driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
        ended.callback(driver.quit)
        driver.get(url)
        yield driver


def draw(page: webdriver.Chrome, pictures: dict[str, tuple[int, int, float, str]]) -> None:
    """Save each picture of what the page shows."""
    for name, (width, height, ratio, scheme) in pictures.items():
        size = {"width": width, "height": height, "deviceScaleFactor": ratio, "mobile": False}
        page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        page.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
        page.execute_script("fit()")
        time.sleep(0.5)
        page.save_screenshot(str(DOCS / f"page-{name}.png"))


if __name__ == "__main__":
    main()
