"""Health by content: hours without a false alarm, and each fault within seconds."""

import random
from collections import Counter

import cv2
import numpy as np
import pytest

from host.config import Cameras
from host.drivers.camera.appearance import look_at
from host.drivers.camera.liveness import Liveness
from host.simulation.pictures.render import Look, frames
from tests.drivers.camera.camera_bench import jpeg

SEED = 20261129


def no_cause() -> tuple[str, str]:
    return "", ""


class Run:
    """A camera on a simulated clock. pictures: some of them, taken again with new noise."""

    def __init__(self, rate_hz: float = 30.0) -> None:
        self.liveness = Liveness(rate_hz, Counter())
        self.now, self.came, self.faults = 0.0, 0, list[str]()
        self.numbers = random.Random(SEED)
        self.whole = [jpeg(k) for k in range(4)]

    def seconds(self, seconds: float, period_s: float, jitter_s: float, lost: float) -> None:
        end, checked = self.now + seconds, self.now
        taken = self.now
        while self.now < end:
            taken += period_s
            self.now = max(self.now, taken + self.numbers.uniform(0.0, jitter_s))
            if self.numbers.random() >= lost:
                picture = self.whole[self.came % 4]
                # A counter behind the data stands for the noise of a sensor.
                self.came += self.liveness.is_new(picture + self.came.to_bytes(4, "big"))
            if self.now - checked >= 1.0:
                checked = self.now
                fault = self.liveness.fault(self.now, self.came, no_cause)
                self.faults += [str(fault)] if fault else []


@pytest.mark.parametrize("rate_hz", [2.0, 15.0, 30.0])
def test_hours_with_jitter_and_losses_are_no_fault(rate_hz: float) -> None:
    print(f"seed {SEED}")
    run = Run(rate_hz)
    run.seconds(2400.0 if rate_hz > 10.0 else 12000.0, 1.0 / rate_hz, 0.8 / rate_hz, 0.05)
    assert run.faults == []


@pytest.mark.parametrize("share", [0.5, 2.0 / 3.0, 1.0 / 6.0])
def test_a_rate_that_falls_is_noticed_within_four_seconds(share: float) -> None:
    run = Run()
    run.seconds(20.0, 1.0 / 30.0, 0.01, 0.0)
    assert run.faults == []
    run.seconds(4.5, 1.0 / (30.0 * share), 0.01, 0.0)
    assert f"{30 * share:.0f} of 30 pictures/s" in run.faults[-1]


def test_a_pause_is_not_taken_for_a_low_rate() -> None:
    run = Run()
    run.seconds(10.0, 1.0 / 30.0, 0.0, 0.0)
    run.now += 30.0
    run.liveness.pause()
    run.seconds(10.0, 1.0 / 30.0, 0.0, 0.0)
    assert run.faults == []


@pytest.mark.parametrize("distinct", [1, 3])
def test_pictures_that_come_again_and_again_are_frozen(distinct: int) -> None:
    counts: Counter[str] = Counter()
    liveness = Liveness(30.0, counts)
    pictures = [jpeg(k) for k in range(distinct)]
    # Another counter in the header of each: what is before the data does not count.
    new = [
        liveness.is_new(picture[:2] + b"\xff\xfe\x00\x04" + k.to_bytes(2, "big") + picture[2:])
        for k, picture in enumerate(pictures * 20)
    ]
    assert sum(new) == distinct
    assert counts["repeated"] == 19 * distinct
    fault = liveness.fault(1.0, distinct, no_cause)
    assert fault is not None
    assert "the pictures are frozen" in str(fault)


def test_the_cause_is_dim_light_only_where_pictures_are_dim() -> None:
    for level, named in ((20, True), (120, False)):
        run = Run()
        noise = np.random.default_rng(1).integers(0, 2 * level, (64, 64, 3), dtype=np.uint8)
        run.whole = [encoded(noise)] * 4
        run.seconds(10.0, 0.2, 0.0, 0.0)
        assert run.faults[-1].startswith("5 of 30 pictures/s")
        assert ("the light is too dim for this exposure" in run.faults[-1]) == named


def encoded(picture: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".jpg", picture)[1])


@pytest.mark.parametrize("brightness", [0.25, 1.0, 2.0])
def test_rendered_pictures_in_dim_and_bright_light_show_something(brightness: float) -> None:
    cameras = Cameras()
    for picture, _ in frames(8, 31, cameras, cameras.front, Look(brightness=brightness)):
        liveness = Liveness(30.0, Counter())
        liveness.is_new(picture)
        look = look_at(picture)
        assert [liveness.fault(float(k), k, None) for k in range(5)] == [None] * 5, look
