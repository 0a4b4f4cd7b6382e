"""Lenses from pictures of a checkerboard, for `swarmloc calibrate camera`."""

import re
from pathlib import Path

import click
import cv2

from host.calibration.camera.checkerboard import (
    BoardView,
    LensFit,
    board_corners,
    find_corners,
    fit_lens,
)
from host.config import Camera, Cameras
from host.errors import UserError

_SUFFIXES = (".jpg", ".jpeg", ".png")


def _folders(
    _context: click.Context, _option: click.Parameter, texts: tuple[str, ...]
) -> dict[str, Path]:
    folders = {}
    for text in texts:
        camera, _, folder = text.partition("=")
        if camera not in ("front", "rear") or not folder:
            raise click.BadParameter(f"{text!r} is not like front=FOLDER or rear=FOLDER.")
        folders[camera] = Path(folder)
    return folders


def _board(_context: click.Context, _option: click.Parameter, text: str) -> tuple[int, int, float]:
    match = re.fullmatch(r"(\d+)x(\d+):(\d*\.?\d+)", text)
    if match is None:
        raise click.BadParameter(f"{text!r} is not like 9x6:0.025.")
    columns, rows, square = int(match[1]), int(match[2]), float(match[3])
    if min(columns, rows) < 3 or not 0.001 < square < 1.0:
        raise click.BadParameter(f"{text!r}: 3 corners a side or more, squares of 1 mm to 1 m.")
    return columns, rows, square


boards_option = click.option(
    "--boards",
    multiple=True,
    callback=_folders,
    metavar="CAMERA=FOLDER",
    help="Folder of one camera's checkerboard pictures, to fit its lens to.",
)
board_option = click.option(
    "--board",
    default="9x6:0.025",
    callback=_board,
    show_default=True,
    metavar="CxR:M",
    help="The checkerboard: inner corners per row and column, and the side of a square in m.",
)


def lenses(
    folders: dict[str, Path], board: tuple[int, int, float], cameras: Cameras
) -> dict[str, LensFit]:
    """The lens of each camera, by its pictures. Raises UserError where they do not determine it."""
    found = {}
    for name, folder in folders.items():
        camera: Camera = getattr(cameras, name)
        found[name] = lens_of(f"{name} camera", folder, board, camera)
    return found


def lens_of(name: str, folder: Path, board: tuple[int, int, float], camera: Camera) -> LensFit:
    """The lens of one camera by the pictures in a folder, reported on the screen.

    Raises UserError where they do not determine it.
    """
    found = fit_lens(_views(folder, board, camera), camera)
    pictures = len(found.poses)
    click.echo(f"{name}: lens fitted to {pictures} pictures, rms {found.rms_px:.2f} px")
    return found


def _views(folder: Path, board: tuple[int, int, float], camera: Camera) -> list[BoardView]:
    paths = sorted(path for path in folder.glob("*") if path.suffix.lower() in _SUFFIXES)
    if not paths:
        raise UserError(
            f"there are no pictures in {folder}",
            "no such folder" if not folder.is_dir() else f"none is called *{', *'.join(_SUFFIXES)}",
            "give the folder of the checkerboard's pictures with --boards",
        )
    columns, rows, square = board
    corners, views = board_corners(columns, rows, square), []
    for path in paths:
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise UserError(f"{path} is no picture", "it cannot be decoded", "remove it")
        if grey.shape != (camera.height_px, camera.width_px):
            raise UserError(
                f"{path} has {grey.shape[1]} x {grey.shape[0]} px",
                f"robot.toml has {camera.width_px} x {camera.height_px} px for this camera",
                "give pictures of that camera at that size",
            )
        pixels = find_corners(grey.astype("uint8"), columns, rows)
        if pixels is not None:
            views.append(BoardView(corners, pixels))
    if not views:
        raise UserError(
            f"no checkerboard was found in {folder}",
            f"{len(paths)} pictures were searched for {columns} x {rows} inner corners",
            "give its inner corners with --board, and pictures that show all of it",
        )
    return views
