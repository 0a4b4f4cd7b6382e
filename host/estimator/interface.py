"""What every filter offers: three calls, in any order of sensors."""

from typing import Protocol, runtime_checkable

from host.messages import Bearings, Displacement, Estimate, Positions


class Filter(Protocol):
    """A multi-target filter in the robot's own frame.

    The caller brings measurements in time order and calls `predict` in between, so that at
    `update` the filter's time is the measurement's. The filter keeps time by the intervals.
    `predict` and `update` raise ValueError for what `message_checks.check` refuses, and stay as
    they were.
    """

    def predict(self, motion: Displacement) -> None:
        """Carry every teammate into the robot's new frame (Perera 2021 eq. 7–11)."""

    def update(self, measurement: Positions | Bearings) -> None:
        """Take in one set of readings made at the filter's time, in the present robot frame."""

    def estimate(self) -> Estimate:
        """Return the teammates it would report now."""


class Judge(Protocol):
    """What compares settings with the data."""

    @property
    def known(self) -> bool:
        """Whether there were enough data."""

    def fault(self) -> str | None:
        """What is wrong, with the next step; None where nothing is."""

    def summary(self) -> str:
        """What was found, as text."""


@runtime_checkable
class Learning(Protocol):
    """A filter that learns how its sensors do; learnt: None where it wraps one that does not."""

    learnt: Judge | None
