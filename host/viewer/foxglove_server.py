"""The topics of a recording, live, for the Foxglove app: over its own protocol, by its SDK."""

import contextlib
import time
from dataclasses import replace
from types import ModuleType
from typing import Any, Self

from host.config import RobotConfig
from host.errors import UserError
from host.messages import Estimate, Message, Now, Scan, Truth
from host.recording.ros.cdr import nanoseconds
from host.recording.ros.definitions import schema
from host.recording.ros.topics import Published, Topics
from host.viewer.access import access
from host.viewer.addresses import bracketed, listening_socket, reachable
from host.viewer.gate import Gate, hidden_address

DEFAULT_PORT = 8765  # where the app looks first
# The app in a browser, and installed. Its SDK's server would let every page in.
APPS = ("https://app.foxglove.dev", "file://")


class FoxgloveServer:
    """Serves from entry to exit of its `with` block. url: what the app connects to.

    Both methods are called in the localizer's thread, which the SDK's own threads never hold.
    Raises UserError where the SDK is missing or cannot listen.
    """

    def __init__(self, config: RobotConfig, address: str, port: int = DEFAULT_PORT) -> None:
        self._sdk = _sdk()
        self._context = self._sdk.Context()
        hidden = hidden_address()
        try:
            with contextlib.ExitStack() as on_failure:
                listening = on_failure.enter_context(listening_socket(address, port))
                self._server = self._sdk.start_server(
                    name=f"swarmloc {config.name}", host=hidden, port=0, context=self._context
                )
                on_failure.pop_all()
        except (RuntimeError, OSError, ValueError) as error:
            raise UserError(
                f"cannot serve Foxglove at {bracketed(address)}:{port}",
                getattr(error, "strerror", None) or str(error),
                "give another address, as --foxglove 127.0.0.1:8766",
            ) from error
        rules = replace(access(address, listening.getsockname()[1]), apps=APPS)
        self._gate = Gate(listening, rules, (hidden, self._server.port))
        token = f"/?token={rules.token}" if rules.token else ""
        self.url = f"ws://{bracketed(reachable(address))}:{rules.port}{token}"
        self._unix_s = time.time() - time.monotonic()
        self._topics = Topics(config, self._unix_s)
        self._channels: dict[str, Any] = {}
        self._mounting_due = 0.0

    def __enter__(self) -> Self:
        self._gate.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._gate.__exit__()  # first: `stop` waits for who still reads
        self._server.stop()

    def take(self, message: Message) -> None:
        """Publish a message. Estimates and truth are published for the present, by `look`."""
        if isinstance(message, Estimate | Truth):
            return
        if isinstance(message, Scan) and message.time >= self._mounting_due:
            self._mounting_due = message.time + 1.0  # who connects later needs it, too
            self._publish(self._topics.mounting(message.time), message.time)
        for published in self._topics.of(message):
            self._publish(published, message.time)

    def look(self, now: Now) -> None:
        """Publish where the teammates are now."""
        for message in (now.estimate, now.truth):
            for published in () if message is None else self._topics.of(message):
                self._publish(published, now.estimate.time)

    def _publish(self, published: Published, moment: float) -> None:
        channel = self._channels.get(published.topic)
        if channel is None:
            definition = self._sdk.Schema(
                name=published.type, encoding="ros2msg", data=schema(published.type)
            )
            channel = self._channels[published.topic] = self._sdk.Channel(
                published.topic, schema=definition, message_encoding="cdr", context=self._context
            )
        channel.log(published.data, log_time=nanoseconds(moment + self._unix_s))


def _sdk() -> ModuleType:
    try:
        import foxglove
    except ImportError as error:
        raise UserError(
            "--foxglove needs foxglove-sdk, which is not installed",
            "",
            "pip install 'swarmloc[foxglove]'",
        ) from error
    return foxglove
