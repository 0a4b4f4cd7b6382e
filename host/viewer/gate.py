"""A proxy with access control before a WebSocket server that has none.

The server behind it listens on a loopback address of this computer that is drawn at random, so that
a web page cannot guess it: 2^24 addresses with some 2^15 ports each.
"""

import asyncio
import contextlib
import http
import ipaddress
import secrets
import socket

from host.viewer.access import Access
from host.viewer.loop_thread import LoopThread

_HEAD_S, _HEAD_BYTES = 5.0, 1 << 14  # for a request to come, and at most
_PIECE_BYTES = 1 << 16
_END = b"\r\n"  # of a line


def hidden_address() -> str:
    """A random loopback address."""
    return str(ipaddress.IPv4Address(0x7F000000 + 2 + secrets.randbelow(2**24 - 4)))


class Gate(LoopThread):
    """Lets requests pass from entry to exit of its `with` block, as `access` has it."""

    def __init__(self, listening: socket.socket, access: Access, behind: tuple[str, int]) -> None:
        """listening: a socket that does. behind: address and port of the server."""
        super().__init__("gate")
        self._listening = listening
        self._access = access
        self._behind = behind

    async def _serve(self) -> None:
        passing: set[asyncio.Task[None]] = set()

        def met(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            task = asyncio.create_task(self._meet(reader, writer))
            passing.add(task)
            task.add_done_callback(passing.discard)

        server = await asyncio.start_server(met, sock=self._listening, limit=_HEAD_BYTES)
        await self._stop.wait()
        server.close()
        for task in passing:
            task.cancel()
        await asyncio.gather(*passing, return_exceptions=True)
        await asyncio.sleep(0.0)  # for the transports to close

    async def _meet(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Let one request pass, or answer why not."""
        try:
            head = await asyncio.wait_for(reader.readuntil(2 * _END), _HEAD_S)
            refusal = refused(head, self._access)
            if refusal:
                writer.write(_answer(refusal))
                await writer.drain()
            else:
                await self._pass(head, reader, writer)
        except (OSError, TimeoutError, EOFError, asyncio.LimitOverrunError, ValueError):
            pass  # it went away, says nothing, or speaks no HTTP
        finally:
            writer.close()

    async def _pass(
        self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Carry bytes both ways until one side has ended."""
        back, forth = await asyncio.open_connection(*self._behind)
        forth.write(head)
        ways = [asyncio.create_task(_carry(*way)) for way in ((reader, forth), (back, writer))]
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            forth.close()


def refused(head: bytes, access: Access) -> str:
    """Why a request (its line and its headers) may not pass, as text; "" where it may.

    Raises ValueError for what is no request.
    """
    line, *fields = head.decode("latin-1").split("\r\n")
    _, target, _ = line.split(" ")
    parted = (field.partition(":") for field in fields)
    headers = [(name.strip().lower(), value.strip()) for name, _, value in parted]
    hosts = [value for name, value in headers if name == "host"]
    origins = [value for name, value in headers if name == "origin"]
    return access.refusal(target, hosts[0] if len(hosts) == 1 else None, origins)


def _answer(refusal: str) -> bytes:
    status = http.HTTPStatus.FORBIDDEN
    body = f"{refusal}\n".encode()
    lines = (
        f"HTTP/1.1 {status.value} {status.phrase}",
        "Content-Type: text/plain; charset=utf-8",
        f"Content-Length: {len(body)}",
        "Connection: close",
    )
    return "".join(f"{line}\r\n" for line in lines).encode() + _END + body


async def _carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while piece := await reader.read(_PIECE_BYTES):
            writer.write(piece)
            await writer.drain()
