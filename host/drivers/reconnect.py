"""A device is taken up again after it was unplugged."""

import threading
from collections.abc import Callable

from host.drivers.serial_port import explain, next_step
from host.errors import UserError

RETRY_S = 0.5


def keep_connected(
    serve: Callable[[], None],
    report: Callable[[UserError], None],
    stop: threading.Event,
    retry_s: float = RETRY_S,
) -> None:
    """Call `serve` again and again until `stop` is set, `retry_s` apart.

    serve: connects, serves one connection and returns when `stop` is set; a UserError or an
    OSError from it goes to `report`, any other error is the program's own and is raised.
    """
    while not stop.is_set():
        try:
            serve()
        except UserError as error:
            report(error)
        except OSError as error:
            report(UserError("the connection was lost", explain(error), next_step(error)))
        stop.wait(retry_s)
