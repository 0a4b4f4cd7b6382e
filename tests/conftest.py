"""What every test may ask for: recorded data, and property tests that repeat."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest

# The same examples every time, on machines of any speed.
hypothesis.settings.register_profile(
    "swarmloc",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile("swarmloc")


@pytest.fixture(scope="session")
def recorded() -> Callable[[str], Path]:
    """Path of a file or folder of recorded data, by its name below SWARMLOC_DATA.

    Where it is absent the test is skipped; in CI (CI=true) it fails, for there it has to run.
    """

    def find(name: str) -> Path:
        root = os.environ.get("SWARMLOC_DATA")
        if root and (Path(root) / name).exists():
            return Path(root) / name
        why = f"{root} has no {name}" if root else "SWARMLOC_DATA names no folder of recorded data"
        if os.environ.get("CI") == "true":
            pytest.fail(why)
        pytest.skip(why)

    return find


def pytest_configure() -> None:
    """What a shell or xdist hands on: Ctrl-C ignored in the background, and a terminal's width."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.pop("COLUMNS", None)
