"""A live run on the screen and on the live page: what `run` and `drive` share."""

import contextlib
import ipaddress
import sys
from collections.abc import Mapping
from pathlib import Path

import click

from host.behaviour.driving import Driving
from host.behaviour.stick import Stick
from host.cli.terminal.console import FRAME_S, LINE_S, Console, State
from host.cli.terminal.signals import signals_caught
from host.errors import UserError
from host.pipeline import Sink
from host.sessions.live import systemd
from host.sessions.live.running import RunOutcome, run_devices
from host.sources.rig import Rig
from host.viewer.foxglove_server import DEFAULT_PORT, FoxgloveServer
from host.viewer.scene import Scene
from host.viewer.server import Viewer

NO_VIEW = ("", 0)
_LAST_PORT = 65535
JOURNAL_S = 60.0  # between two lines of a service


def address_given(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> tuple[str, int] | None:
    """(address, port) of ADDRESS:PORT, NO_VIEW of "none"; None where nothing is given."""
    if value is None:
        return None
    if value == "none" and param.name == "view":
        return NO_VIEW
    host, _, port = value.rpartition(":")
    try:
        address = ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        address = None
    if address is None or not port.isdecimal() or int(port) > _LAST_PORT:
        raise click.BadParameter(
            f"{value!r} is no address with a port up to {_LAST_PORT}, as 127.0.0.1:8737 or "
            "[::1]:8737."
        )
    return str(address), int(port)


view_option = click.option(
    "--view",
    metavar="ADDRESS:PORT",
    callback=address_given,
    help="Where to serve the live page; 0.0.0.0:8737 shares it with anyone who has the printed "
    "address, none serves no page.  [default: this computer only, 127.0.0.1:8737 or a free port]",
)


foxglove_option = click.option(
    "--foxglove",
    metavar="[ADDRESS:PORT]",
    is_flag=False,
    flag_value=f"127.0.0.1:{DEFAULT_PORT}",
    callback=address_given,
    help="Serve the recording's topics live to the Foxglove app.  [without address: this computer "
    f"only, ws://127.0.0.1:{DEFAULT_PORT}]",
)


def check_failures(outcome: RunOutcome) -> None:
    """Raise what ended a part of the run before its time, if anything did."""
    for name, error in outcome.failures.items():
        if isinstance(error, UserError):
            raise error
        raise RuntimeError(f"the {name} failed ({type(error).__name__}: {error})") from error


def viewer_at(rig: Rig, view: tuple[str, int] | None, stick: Stick | None = None) -> Viewer | None:
    """The server of the live page; None where none is wanted. Raises UserError.

    stick: who opens the page may drive by it.
    """
    scene = Scene(rig.config, rig.config.filter.profile, [camera.name for camera in rig.cameras])
    if view == NO_VIEW:
        return None
    viewer = Viewer(scene, *view, stick) if view is not None else _somewhere(scene, stick)
    for camera in rig.cameras:
        camera.watchers.append(viewer.show)
    return viewer


def _somewhere(scene: Scene, stick: Stick | None) -> Viewer:
    try:
        return Viewer(scene, stick=stick)
    except UserError:  # another run has the port
        return Viewer(scene, port=0, stick=stick)


def show_run(
    rig: Rig,
    seconds: float | None,
    record: Path | None,
    viewers: Mapping[str, Viewer | FoxgloveServer],
    driving: Driving | None = None,
) -> RunOutcome:
    """Run with the teammates on the screen, until a signal, for `seconds` or until a failure.

    A screen that is gone ends the run in good order, too.

    driving: drives the robot meanwhile; the run ends when it is done.
    """
    title = rig.title if record is None else f"{rig.title}   recording {record.name}"
    page = "   ".join(viewer.url for viewer in viewers.values())
    state = State(title, rig.config.filter.profile, rig.sensors, page)
    service = systemd.of_environment(rig.sources)
    console = Console(state, sys.stdout, line_s=LINE_S if service is None else JOURNAL_S)
    sinks: dict[str, Sink] = {} if service is None else {"systemd": service.take}
    # Signals are caught until the devices are left in good order.
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.closing(console))
        if service is not None:
            stack.enter_context(contextlib.closing(service))
        signalled = stack.enter_context(signals_caught())
        if driving is not None:
            driving.stopped = signalled
        return run_devices(
            rig,
            sinks,
            {"screen": console, **viewers},
            seconds=seconds,
            record=record,
            stopped=lambda: signalled() or console.gone or (driving is not None and driving.done),
            watch=console.draw,
            watch_every_s=FRAME_S,
            driver=driving,
        )
