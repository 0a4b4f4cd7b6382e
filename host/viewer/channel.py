"""The newest value for any number of readers: a slow one skips values and delays no other."""

import asyncio
from collections.abc import Sequence

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed


class Channel:
    """Belongs to the server's event loop, but for `wanted`, which any thread may ask."""

    def __init__(self) -> None:
        self.readers: set[ServerConnection] = set()
        self._newest: tuple[int, Sequence[str | bytes]] = 0, ()  # its number and its messages
        self._news = asyncio.Condition()
        self._over = False

    @property
    def wanted(self) -> bool:
        """Whether there are readers; else values need not be made."""
        return bool(self.readers)

    async def publish(self, *messages: str | bytes) -> None:
        """Make these what the readers get next, together and in this order."""
        async with self._news:
            self._newest = self._newest[0] + 1, messages
            self._news.notify_all()

    async def close(self) -> None:
        """Let every reader go."""
        async with self._news:
            self._over = True
            self._news.notify_all()

    async def serve(self, connection: ServerConnection) -> None:
        """Send one reader the newest again and again, until it goes."""
        self.readers.add(connection)
        number = 0
        try:
            while not self._over:
                async with self._news:
                    while self._newest[0] == number and not self._over:
                        await self._news.wait()
                    number, messages = self._newest
                for message in messages:
                    await connection.send(message)
        except ConnectionClosed:
            pass
        finally:
            self.readers.discard(connection)
