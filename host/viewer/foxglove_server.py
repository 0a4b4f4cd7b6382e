"""The topics of a recording, live, for the Foxglove app: over its own protocol, by its SDK."""

import time
from types import ModuleType, TracebackType
from typing import Any, Self

from host.config import RobotConfig
from host.errors import UserError
from host.messages import Estimate, Message, Scan, Truth
from host.pipeline import Now
from host.recording.ros.cdr import nanoseconds
from host.recording.ros.definitions import schema
from host.recording.ros.topics import Published, Topics

DEFAULT_PORT = 8765  # where the app looks first


class FoxgloveServer:
    """Serves from entry to exit of its `with` block. url: what the app connects to.

    Both methods are called in the localizer's thread, which the SDK's own threads never hold.
    Raises UserError where the SDK is missing or cannot listen.
    """

    def __init__(self, config: RobotConfig, address: str, port: int = DEFAULT_PORT) -> None:
        self._sdk = _sdk()
        self._context = self._sdk.Context()
        try:
            self._server = self._sdk.start_server(
                name=f"swarmloc {config.name}", host=address, port=port, context=self._context
            )
        except (RuntimeError, OSError) as error:
            raise UserError(
                f"cannot serve Foxglove at {address}:{port}",
                str(error),
                "give another address, as --foxglove 127.0.0.1:8766",
            ) from error
        self.url = f"ws://{address}:{self._server.port}"
        self._unix_s = time.time() - time.monotonic()
        self._topics = Topics(config, self._unix_s)
        self._channels: dict[str, Any] = {}
        self._mounting_due = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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
