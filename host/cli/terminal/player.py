"""A recording shown on the screen and the page, at the pace that a person asks for."""

import contextlib
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence

from host.cli.terminal.console import FRAME_S, Console, State
from host.cli.terminal.signals import signals_caught
from host.messages import (
    Bearings,
    Displacement,
    Estimate,
    Measurement,
    Message,
    Now,
    Picture,
    Positions,
    Truth,
)
from host.sessions.recordings.replaying import Replayed, Result
from host.systems.id_phd.naming import Naming
from host.viewer.playback import Playback, SeekBackError
from host.viewer.server import Viewer

_SAME_S = 1e-3  # a picture's time is rounded
_RECENT = 100  # pictures and bearings: some 2 s of both cameras


class EndedError(Exception):
    """A signal to end came."""


class Player:
    """Shows messages on the screen and the page when the playback comes to them.

    naming: is to be given what is replayed; it knows the names.
    """

    def __init__(
        self,
        console: Console,
        playback: Playback,
        viewer: Viewer | None,
        ended: Callable[[], bool],
    ) -> None:
        self._console, self._playback, self._viewer = console, playback, viewer
        self.naming = Naming()
        self._ended = ended
        self._next_frame = time.monotonic()
        self._estimate: Estimate | None = None
        self._recent: deque[Picture | Bearings] = deque(maxlen=_RECENT)
        self._pictures: dict[str, tuple[bytes, Bearings]] = {}  # by camera, to be shown
        self._truths: deque[Truth] = deque(maxlen=8)  # the last ones

    def take(self, message: Message | None, made: Sequence[Result]) -> None:
        """Wait until a message is due, then show it and what was made of it."""
        if isinstance(message, Displacement):  # they come all the time, and at once
            self._playback.reach(message.time, self.show)
            if time.monotonic() >= self._next_frame:
                self.show()
        if isinstance(message, Truth):
            self._truths.append(message)
        elif isinstance(message, Picture | Bearings):
            self._note_picture(message)
        if message is not None:
            self._console.take(message)
            if self._viewer is not None:
                self._viewer.take(message)
        estimates = [each for each in made if isinstance(each, Estimate)]
        if estimates:
            self._estimate = estimates[-1]
            self._playback.estimated()
        if message is None:
            self.show()

    def used(self, measurement: Measurement, readings: Positions | Bearings) -> None:
        """Show what was found in a measurement, too."""
        if self._viewer is not None:
            self._viewer.take(readings)

    def show(self) -> None:
        """The newest estimate, with the truth that is closest to it in time, before or after.

        Raises EndedError after a signal to end.
        """
        if self._ended():
            raise EndedError
        self._next_frame = time.monotonic() + FRAME_S / 2.0
        if self._estimate is not None:
            moment = self._estimate.time
            truth = min(self._truths, key=lambda each: abs(each.time - moment), default=None)
            now = Now(self._estimate, moment, truth, self.naming.at(moment))
            self._console.look(now)
            if self._viewer is not None:
                self._viewer.look(now)
                for picture in self._pictures.values():  # who asks may come while it rests
                    self._viewer.show(*picture)
        self._console.draw()

    def _note_picture(self, message: Picture | Bearings) -> None:
        """Find a picture's bearings, or the picture of these: either may come first.

        Where the computer was busy, that was seconds before.
        """
        other = Bearings if isinstance(message, Picture) else Picture
        for each in self._recent:
            alike = isinstance(each, other) and each.camera == message.camera
            if alike and abs(each.time - message.time) < _SAME_S:
                picture, seen = (message, each) if other is Bearings else (each, message)
                if isinstance(picture, Picture) and isinstance(seen, Bearings):
                    self._pictures[message.camera] = picture.jpeg, seen
                return
        self._recent.append(message)


def play(
    replay_once: Callable[[Player], Replayed],
    playback: Playback,
    state: State,
    viewer: Viewer | None,
) -> Replayed | None:
    """Replay on the screen and the page, until its end or a signal; None before a first end.

    With a page it rests at the end, and restarts where that is asked for.
    """
    replayed = None
    console = Console(state, sys.stdout)
    with contextlib.closing(console), signals_caught() as ended:
        while True:
            player = Player(console, playback, viewer, ended)
            try:
                replayed = replay_once(player)
                if viewer is None:
                    return replayed
                playback.rest(player.show)
            except SeekBackError:
                playback.restart()
                if viewer is not None:
                    viewer.clear()
            except EndedError:
                return replayed
