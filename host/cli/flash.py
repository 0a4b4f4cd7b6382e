"""`swarmloc flash`: the board's firmware, built, uploaded and read back."""

from pathlib import Path

import click

from host.cli.files import json_option, write_json
from host.drivers.romeo.checks import firmware_version
from host.drivers.romeo.ports import AUTO
from host.flashing import build as romeo_build
from host.flashing import flash as romeo_flash
from host.flashing import identity as romeo_identity
from host.flashing.firmware import FLASH_BYTES, RAM_BYTES, Firmware


@click.command(
    "flash",
    short_help="Build and upload the board's firmware.",
    epilog="""\b
Examples:
  swarmloc flash
  swarmloc flash --port /dev/ttyACM0
  swarmloc flash --build-only --json firmware.json""",
)
@click.option(
    "--port",
    default=AUTO,
    metavar="PORT",
    help="The board's serial port.  [default: found by its USB id]",
)
@click.option("--build-only", is_flag=True, help="Build only, without a board.")
@json_option
def flash_command(port: str, build_only: bool, json_path: Path | None) -> None:
    """Build the firmware, upload it, and read the version back from the board.

    It is built with PlatformIO if that is installed and complete, else with Debian's avr-gcc.
    """
    click.echo("building the firmware (the first time it may take some minutes)")
    firmware = romeo_build.build()
    figures = _figures(firmware)
    click.echo(f"built with {firmware.built_with}")
    click.echo(f"  ELF    {firmware.elf}")
    click.echo(f"  flash  {_share(firmware.flash_bytes, FLASH_BYTES)}")
    click.echo(f"  RAM    {_share(firmware.ram_bytes, RAM_BYTES)}, without the stack")
    if not build_only:
        flashed = romeo_flash.flash(firmware, port, click.echo)
        identity = flashed.identity
        click.echo(f"done: the board runs {romeo_identity.in_words(identity)}")
        figures |= {
            "port": flashed.port,
            "version": firmware_version(identity),
            "protocol_hash": f"{identity.protocol_hash:08x}",
        }
    write_json(json_path, figures)


def _figures(firmware: Firmware) -> dict[str, str | int | float]:
    return {
        "elf": str(firmware.elf),
        "built_with": firmware.built_with,
        "flash_bytes": firmware.flash_bytes,
        "flash_percent": round(100 * firmware.flash_bytes / FLASH_BYTES, 1),
        "ram_bytes": firmware.ram_bytes,
        "ram_percent": round(100 * firmware.ram_bytes / RAM_BYTES, 1),
    }


def _share(used: int, whole: int) -> str:
    return f"{used} bytes, {100 * used / whole:.1f} % of {whole}"
