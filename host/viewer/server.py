"""The live page and its stream: a small web server in its own thread.

The localizer's thread hands over a text and goes on; each reader gets the newest text when it is
ready for one, so a slow reader skips and delays nobody.
"""

import asyncio
import http
import json
import socket
import time
from typing import Any
from weakref import WeakSet

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from host.behaviour.stick import Stick
from host.errors import UserError
from host.messages import Bearings, Message, Now
from host.viewer.access import access
from host.viewer.addresses import bracketed, listening_socket, reachable
from host.viewer.channel import Channel
from host.viewer.loop_thread import LoopThread
from host.viewer.page import page
from host.viewer.scene import Scene, blobs
from host.viewer.steering import Steering

DEFAULT_PORT = 8737
_STREAM, _PICTURES, _PLAYBACK = "/stream", "/pictures", "/playback"
_DRIVE = "/drive"
_PICTURE_S = 0.2  # between two pictures of a camera
# The page may use what is in it and talk to this server; nothing else, and nobody may frame it.
_NO_WEB = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_GOODBYE_S = 0.4  # for readers to take leave; then they are cut off
_READER_BUFFER = 65536  # bytes towards one reader; more would only grow old


class Viewer(LoopThread):
    """Serves from entry to exit of its `with` block. url: what a person opens.

    address, port: where it listens; port 0: a free one. stick: who opens the page may drive by it.
    Raises UserError where it cannot.
    """

    def __init__(
        self,
        scene: Scene,
        address: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        stick: Stick | None = None,
    ) -> None:
        super().__init__("viewer")
        self._scene = scene
        self._socket = _listening(address, port)
        driven = stick is not None
        self._access = access(address, self._socket.getsockname()[1], driven)
        token = f"/?token={self._access.token}" if self._access.token else "/"
        self.url = f"http://{bracketed(reachable(address))}:{self._access.port}{token}"
        self._page = page(driven).encode()
        of_cameras = [f"{_PICTURES}/{camera}" for camera in scene.pictures]
        self._channels = {path: Channel() for path in (_STREAM, *of_cameras)}
        self._serving = {path: channel.serve for path, channel in self._channels.items()}
        if scene.playback is not None:
            self._serving[_PLAYBACK] = self._obey
        if stick is not None:
            self._serving[_DRIVE] = Steering(stick).serve
        self._due = dict.fromkeys(scene.pictures, 0.0)  # when the next picture may go, s

    def take(self, message: Message) -> None:
        """Note a message, in the localizer's thread."""
        self._scene.take(message)

    def clear(self) -> None:
        """Forget what was taken: a replay restarts."""
        self._scene.clear()

    def look(self, now: Now) -> None:
        """Send the present state to the readers, if any, in the localizer's thread."""
        if self._channels[_STREAM].wanted:
            self._send(_STREAM, _json(self._scene.message(now)))

    def show(self, jpeg: bytes, seen: Bearings) -> None:
        """Hand on a camera's picture and what was found in it, in the camera's thread.

        Nothing without a reader, and not more than a few a second.
        """
        now = time.monotonic()
        if self.asked(seen.camera) and now >= self._due[seen.camera]:
            self._due[seen.camera] = now + _PICTURE_S
            self._send(f"{_PICTURES}/{seen.camera}", _json(blobs(seen)), jpeg)

    def asked(self, camera: str) -> bool:
        """Does anybody want to see what this camera sees?"""
        channel = self._channels.get(f"{_PICTURES}/{camera}")
        return channel is not None and channel.wanted

    def _send(self, path: str, *messages: str | bytes) -> None:
        asyncio.run_coroutine_threadsafe(self._channels[path].publish(*messages), self._loop)

    async def _serve(self) -> None:
        connections: WeakSet[asyncio.Transport] = WeakSet()

        class Noted(ServerConnection):
            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                assert isinstance(transport, asyncio.Transport)
                connections.add(transport)
                super().connection_made(transport)

        async with serve(
            self._read,
            create_connection=Noted,
            sock=self._socket,
            process_request=self._answer,
            compression=None,  # the robot's time is worth more than a network's bytes
            max_size=1024,
            max_queue=4,
            write_limit=_READER_BUFFER,
            ping_timeout=60.0,  # who reads slowly answers late
            close_timeout=0.5,
            server_header=None,
        ) as server:
            await self._stop.wait()
            for channel in self._channels.values():
                await channel.close()
            server.close()
            try:
                await asyncio.wait_for(server.wait_closed(), _GOODBYE_S)
            except TimeoutError:
                # Who reads nothing, not even the end; and what a browser opened and has no use for.
                for transport in connections:
                    transport.abort()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page or a refusal; None lets a reader on to the stream."""
        origins = request.headers.get_all("Origin")
        refusal = self._access.refusal(request.path, request.headers.get("Host"), origins)
        path = _path(request)
        if refusal:
            return connection.respond(http.HTTPStatus.FORBIDDEN, refusal + "\n")
        if path in self._serving:
            return None
        if path != "/":
            known = ", ".join(["/", *self._serving])
            return connection.respond(http.HTTPStatus.NOT_FOUND, f"there is {known}\n")
        headers = Headers(
            {
                "Content-Type": "text/html; charset=utf-8",
                "Content-Length": str(len(self._page)),
                "Content-Security-Policy": _NO_WEB,
                "Cache-Control": "no-store",
                "Referrer-Policy": "no-referrer",
                "Connection": "close",
            }
        )
        return Response(200, "OK", headers, self._page)

    async def _read(self, connection: ServerConnection) -> None:
        """Serve one reader until it goes."""
        assert connection.request is not None
        await self._serving[_path(connection.request)](connection)

    async def _obey(self, connection: ServerConnection) -> None:
        """Do with the replay what a reader asks for; what cannot be done is answered in words."""
        assert self._scene.playback is not None
        async for message in connection:
            try:
                wish = json.loads(message)
                self._scene.playback.command(wish["do"], wish.get("to"))
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                await connection.send(_json({"error": f"not done: {error}"}))


def _json(content: dict[str, Any]) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


def _path(request: Request) -> str:
    return request.path.partition("?")[0]


def _listening(address: str, port: int) -> socket.socket:
    """A socket that listens. Raises UserError where there can be none."""
    try:
        return listening_socket(address, port)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UserError(
            f"cannot serve the live page at {bracketed(address)}:{port}",
            reason,
            "give another one, as --view 127.0.0.1:8080, or --view none",
        ) from error
