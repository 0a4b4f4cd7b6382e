"""The doctor's run: every device at work for some seconds, and what came of it."""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from host.cross_checks.checks import CrossChecks
from host.errors import UserError
from host.estimator import profiles
from host.localizer import Localizer
from host.messages import Bearings, Bodies, Displacement, Health, Message, Scan
from host.pipeline import Pipeline, Source
from host.sources.rig import Rig

SECONDS = 12.0  # the lidar needs 5 s to get up to speed, and 5 s to show what covers its window


@dataclass
class Watched:
    """What came. health: the last of each device.

    failures: of devices that ended before their time, or did not end in time.

    Times are the host's monotonic ones, s.
    """

    health: dict[str, Health] = field(default_factory=dict)
    scans: list[Scan] = field(default_factory=list)
    steps: list[Displacement] = field(default_factory=list)
    bearings: list[Bearings] = field(default_factory=list)
    bodies: list[Bodies] = field(default_factory=list)
    failures: dict[str, UserError] = field(default_factory=dict)
    # Messages come in one thread while another one reads.
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def take(self, message: Message) -> None:
        """Keep what the doctor reads."""
        with self._lock:
            if isinstance(message, Health):
                self.health[message.device] = message
            elif isinstance(message, Scan):
                self.scans.append(message)
            elif isinstance(message, Displacement):
                self.steps.append(message)
            elif isinstance(message, Bearings):
                self.bearings.append(message)
            elif isinstance(message, Bodies):
                self.bodies.append(message)


def watch(
    rig: Rig,
    more: Mapping[str, Source],
    seconds: float = SECONDS,
    meanwhile: Callable[[Watched], None] | None = None,
    progress: Callable[[float, float], None] = lambda at, whole: None,
) -> Watched:
    """Run the devices of a rig, and `more` beside them, for so long, and keep what came.

    meanwhile: called once all run; what it takes is not counted in the seconds. progress: told
    (seconds so far, seconds in all). Raises what is the program's own fault.
    """
    watched = Watched()
    localizer = Localizer(rig.config, profiles.make(rig.config.filter.profile, rig.config))
    sources = {**rig.sources, **more}
    with Pipeline(
        localizer,
        sources,
        {"doctor": watched.take},
        followers={"cross-checks": CrossChecks(rig.config)},
    ) as pipeline:
        begin = time.monotonic()
        while (passed := time.monotonic() - begin) < seconds and not pipeline.stop.wait(0.2):
            progress(passed, seconds)
        if meanwhile is not None and not pipeline.stop.is_set():
            meanwhile(watched)
        # Devices stop with the pipeline, and may have their last words.
        kept = replace(watched, health=dict(watched.health))
    for name, error in pipeline.failures.items():
        if not isinstance(error, UserError):
            raise error
        kept.failures[name] = error
    return kept
