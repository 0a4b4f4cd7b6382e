"""Draw docs/page-*.png: the live page of a simulated run, as a laptop and a phone show it.

    python -m tools.draw_page

Needs chromium and chromium-driver (Debian), and selenium (extra `test`).
"""

import re
import subprocess
import sys
import time
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

DOCS = Path(__file__).resolve().parents[1] / "docs"
RUN = [str(Path(sys.executable).with_name("swarmloc")), "run"]
SETTLE_S = 20.0  # trails are long by then
# Width, height (CSS pixels), pixels a CSS pixel, and the scheme, of each picture.
PICTURES = {
    "laptop-light": (1180, 720, 1, "light"),
    "laptop-dark": (1180, 720, 1, "dark"),
    "phone-light": (390, 844, 2, "light"),
    "phone-dark": (390, 844, 2, "dark"),
}


def main() -> None:
    """Run, wait until there is something to see, and draw."""
    arguments = ["--simulate", "furnished6:seed=4", "--seconds", "90", "--view", "127.0.0.1:0"]
    options = Options()
    for argument in ("--headless=new", "--no-sandbox", "--hide-scrollbars"):
        options.add_argument(argument)
    with subprocess.Popen([*RUN, *arguments], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        (url,) = next(filter(None, (re.findall(r"http://\S+", line) for line in run.stdout)))
        driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
        driver.get(url)
        time.sleep(SETTLE_S)
        for name, (width, height, ratio, scheme) in PICTURES.items():
            size = {"width": width, "height": height, "deviceScaleFactor": ratio, "mobile": False}
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
            driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
            driver.execute_script("fit()")
            time.sleep(0.5)
            driver.save_screenshot(str(DOCS / f"page-{name}.png"))
        driver.quit()
        run.terminate()
        run.communicate()


if __name__ == "__main__":
    main()
