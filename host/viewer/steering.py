"""Who steers by the live page: one page at a time, for as long as its stick is held."""

import contextlib
import json
import math
import time
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from host.behaviour.stick import SILENT_S, Stick


class Steering:
    """Belongs to the server's event loop."""

    def __init__(self, stick: Stick) -> None:
        self._stick = stick
        self._holder: ServerConnection | None = None
        self._until = -math.inf  # until then nobody else may steer, s

    async def serve(self, connection: ServerConnection) -> None:
        """Move the stick as a page says; let go when it is gone. What is wrong is answered."""
        try:
            with contextlib.suppress(ConnectionClosed):
                async for message in connection:
                    error = self._obey(connection, message)
                    if error:
                        await connection.send(json.dumps({"error": error}))
        finally:
            self._let_go(connection)

    def _obey(self, connection: ServerConnection, message: str | bytes) -> str:
        """Do as a message says. Returns what is wrong, as text; "": nothing is."""
        now = time.monotonic()
        try:
            said = json.loads(message)
            ahead, left = _share(said["ahead"]), _share(said["left"])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            self._let_go(connection)
            return f"not done: {type(error).__name__}: {error}"
        if ahead == left == 0.0:
            self._let_go(connection)
            return ""
        if self._holder not in (None, connection) and now < self._until:
            return "another page steers"
        self._holder, self._until = connection, now + SILENT_S
        self._stick.move(ahead, left, now)
        return ""

    def _let_go(self, connection: ServerConnection) -> None:
        if self._holder is connection:
            self._holder = None
            self._stick.release()


def _share(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= 1:
        raise ValueError("ahead and left are numbers from -1 to 1")
    return float(value)
