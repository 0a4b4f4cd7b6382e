"""A served scene, and a real browser to look at it with."""

import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.chrome.webdriver import WebDriver

from host.behaviour.stick import Stick
from host.messages import Bearings, Message, Now
from host.viewer.server import Viewer
from tests.viewer import scenes

LONG_S = 30.0  # a bound on waiting, not on speed


class Served:
    """A viewer that is told the same over and over, as a run would do."""

    def __init__(
        self,
        *messages: Message,
        now: Now | None = None,
        address: str = "127.0.0.1",
        pictures: Sequence[str] = (),
        picture: tuple[bytes, Bearings] | None = None,
        stick: Stick | None = None,
    ) -> None:
        self.now = now or scenes.now(1.0, (1.0, 0.5))
        self.viewer = Viewer(scenes.a_scene(pictures), address, 0, stick)
        self._messages, self._picture = messages, picture
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._tell)

    def start(self) -> "Served":
        """Serve, and tell."""
        self.viewer.__enter__()
        self._thread.start()
        return self

    def stop(self) -> None:
        """End it, as a run that is over does."""
        if self._over.is_set():
            return
        self._over.set()
        self._thread.join()
        self.viewer.__exit__(None, None, None)

    @property
    def stream(self) -> str:
        page, _, query = self.viewer.url.partition("?")
        return page.replace("http:", "ws:") + "stream" + (f"?{query}" if query else "")

    def _tell(self) -> None:
        while not self._over.wait(0.02):
            for message in self._messages:
                self.viewer.take(message)
            self.viewer.look(self.now)
            if self._picture is not None:
                self.viewer.show(*self._picture)


@pytest.fixture
def served() -> Iterator[Callable[..., Served]]:
    """Serves a scene until the test ends: `served(message, ..., now=...)`."""
    running: list[Served] = []

    def start(*messages: Message, **how: Any) -> Served:
        running.append(Served(*messages, **how).start())
        return running[-1]

    yield start
    for each in running:
        each.stop()


class Browser:
    """A window of Chromium without a screen."""

    def __init__(self, driver: WebDriver) -> None:
        self.driver = driver

    def wait_for(self, script: str) -> object:
        """The value of a JavaScript expression, once it is true."""
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            value = self.driver.execute_script(f"return {script}")
            if value:
                return value
            time.sleep(0.05)
        raise AssertionError(f"{script} stays false; {self.driver.get_log('browser')}")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    chromium, chromedriver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and chromedriver):
        assert os.environ.get("CI") != "true", "chromium and chromium-driver are not installed"
        pytest.skip("no browser: apt-get install chromium chromium-driver")
    options = Options()
    options.binary_location = chromium
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1280,800"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(chromedriver))
    yield Browser(driver)
    driver.quit()
