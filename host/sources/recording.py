"""How a recording does: how much is written, whether the disk keeps up, how long its room lasts."""

import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path

from host.drivers.health import HealthReporter
from host.errors import UserError
from host.messages import Message
from host.recording.background import BackgroundRecorder

RECORDING = "recording"
USUAL_RATE = 4e4  # bytes/s: of a lidar, a board, cameras' bearings and the estimates
OTHER_DISK = "use another card or disk, or record to one (--record /path/on/it/FILE)"
DELETE = "delete what is not needed (ls -S *.mcap), or record to another disk"
_PERIOD_S = 1.0
_BEHIND_S = 2.0  # a disk is asked to make what it has safe once per second
_SHORT_S, _SOON_S = 4 * 3600.0, 900.0  # until the disk is full


class RecordingHealth:
    """Reports the Health of a recording at `path`: `run` it in a thread."""

    def __init__(
        self, recorder: BackgroundRecorder, path: Path, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._recorder, self._folder = recorder, path.absolute().parent
        self._clock = clock
        self._health = HealthReporter(RECORDING, clock, _PERIOD_S)

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Health once per second until `stop` is set."""
        begin, before = self._clock(), self._recorder.written
        while not stop.wait(_PERIOD_S):
            rate = (self._recorder.written - before) / (self._clock() - begin)
            full, little = room(self._folder, rate)
            wrong = self._recorder.failure or full
            words = [f"{rate / 1e3:.0f} kB/s", *self._behind(rate), *little]
            reason = str(wrong or "; ".join(words))
            self._health.report(emit, wrong is None, reason, dict, certain=True)

    def _behind(self, rate: float) -> list[str]:
        behind_s = self._recorder.waiting / max(rate, 1.0)
        if self._recorder.leaves_out_pictures:
            return [f"its disk is {behind_s:.0f} s behind, pictures are left out: {OTHER_DISK}"]
        return [f"its disk is {behind_s:.0f} s behind: {OTHER_DISK}"] * (behind_s > _BEHIND_S)


def room(folder: Path, rate: float = USUAL_RATE) -> tuple[UserError | None, list[str]]:
    """What ends a recording soon; or a remark where its disk is full within hours.

    rate: that it takes, bytes/s.
    """
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        why = error.strerror or str(error)
        return UserError(f"nothing can be recorded in {folder}", why, OTHER_DISK), []
    lasts_s = free / max(rate, 1.0)
    if lasts_s < _SOON_S:
        fault = UserError(
            f"only {free / 1e6:.0f} MB are free",
            f"a recording of {rate / 1e3:.0f} kB/s fills that within {lasts_s / 60.0:.0f} min",
            DELETE,
        )
        return fault, []
    if lasts_s < _SHORT_S:
        return None, [f"only {free / 1e6:.0f} MB are free, for {lasts_s / 3600.0:.1f} h: {DELETE}"]
    return None, []
