"""`swarmloc calibrate colour`: the colour of the teammates' strips, learnt from pictures."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import cv2
import numpy as np

from host.calibration.camera import colour as strip_colour
from host.calibration.camera.colour import Box
from host.calibration.camera.colour_verdict import LEARNT, SearchedPicture, judged, searched
from host.cli.calibrate.fitting import Fitting, result_options
from host.cli.files import OutputFile
from host.config import Camera, Cameras, Strip
from host.errors import UserError, cannot_write
from host.messages import Image
from host.perception.jpeg_decoder import UnusableError, decode, size_of
from host.perception.strips.blob import Blob
from host.perception.strips.finder import StripFinder
from host.perception.strips.geometry import StripGeometry
from host.sessions.robot import robot_configuration


def _boxes(
    _context: click.Context, _option: click.Parameter, texts: tuple[str, ...]
) -> list[tuple[Box, ...]]:
    """The boxes of each picture, by plus signs. Raises a usage error for one that is no box."""
    return [tuple(_box(part) for part in text.split("+")) for text in texts]


def _box(text: str) -> Box:
    try:
        x, y, width, height = (int(part) for part in text.split(","))
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is not like 840,130,60,30.") from error
    if min(x, y) < 0 or min(width, height) < 1:
        raise click.BadParameter(f"{text!r}: x, y from 0 on, width and height from 1 on.")
    return x, y, width, height


@click.command()
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--box",
    "boxes",
    callback=_boxes,
    multiple=True,
    metavar="X,Y,W,H[+...]",
    help="Boxes around the strips in one picture, px, joined by +; once for each picture.  "
    "[default: the most saturated blob]",
)
@click.option(
    "--eye",
    "camera_name",
    type=click.Choice(["front", "rear"]),
    default="front",
    show_default=True,
    help="Camera that took the pictures.",
)
@click.option(
    "--output",
    type=OutputFile(),
    default=Path("annotated.png"),
    show_default=True,
    metavar="FILE",
    help="Picture of what is detected; further pictures get -2, -3, ...",
)
@result_options("colour")
def colour(
    images: tuple[Path, ...],
    boxes: list[tuple[Box, ...]],
    camera_name: str,
    robot_path: Path | None,
    output: Path,
    report_path: Path,
    accept: bool,
    json_path: Path | None,
) -> None:
    """Learn the colour of the teammates' strips from a few camera pictures.

    \b
    Example, with a box around each of the strips in the two pictures:
      swarmloc calibrate colour front.jpg near.jpg --box 840,130,60,30+300,190,40,22 \\
        --box 700,160,80,40 --robot robot.toml
    """
    if boxes and len(boxes) != len(images):
        raise click.BadParameter(
            f"{len(boxes)} for {len(images)} picture(s): give one each, or none.",
            param_hint="--box",
        )
    fitting = Fitting(robot_path, report_path, accept, json_path)
    cameras = robot_configuration(robot_path).camera
    camera: Camera = getattr(cameras, camera_name)
    jpegs = [strip_colour.read_picture(path) for path in images]
    reduced = [
        _decoded(path, jpeg, camera, camera_name) for path, jpeg in zip(images, jpegs, strict=True)
    ]
    given = boxes or [()] * len(images)
    strip = cameras.strip
    if strip.pattern == "one_colour":
        strip = strip_colour.learn(_strip_pixels(reduced, given, cameras, camera), strip)
    finder = StripFinder(cameras.model_copy(update={"strip": strip}), camera)
    outputs = [output, *(output.with_stem(f"{output.stem}-{k + 2}") for k in range(len(images)))]
    pictures = [
        searched(str(path), picture, finder.search(jpeg), of_strips, strip, finder.geometry)
        for path, jpeg, picture, of_strips in zip(outputs, jpegs, reduced, given, strict=False)
    ]
    for path, jpeg, seen in zip(outputs, jpegs, pictures, strict=False):
        drawn = strip_colour.annotate(
            jpeg, seen.blobs, finder.geometry, seen.boxes, seen.others, seen.background
        )
        _write_picture(path, drawn)
    click.echo(_lines(strip))
    click.echo()
    for image, seen in zip(images, pictures, strict=True):
        click.echo(f"{image}: {_summary(seen.blobs)}; drawn in {seen.name}")
    click.echo()
    fitting.conclude(
        judged(cameras.strip, strip, pictures),
        ", ".join(map(str, images)),
        strip={name: getattr(strip, name) for name in ("pattern", *LEARNT)},
        pictures=[_figures(*each) for each in zip(images, pictures, strict=True)],
    )


def _figures(image: Path, seen: SearchedPicture) -> dict[str, Any]:
    """What was found in one picture, for --json."""
    return {
        "image": str(image),
        "annotated": seen.name,
        "blobs": [dataclasses.asdict(blob) for blob in seen.blobs],
    }


def _decoded(image: Path, jpeg: bytes, camera: Camera, camera_name: str) -> Image:
    """The whole picture, reduced. Raises UserError for one that is not usable."""
    try:
        return decode(jpeg, (camera.width_px, camera.height_px), camera.height_px)
    except UnusableError as error:
        why = "it is torn"
        if str(error) == "wrong_size":
            why = (
                "it has {} x {} px, ".format(*size_of(jpeg))
                + f"but [camera.{camera_name}] says {camera.width_px} x {camera.height_px}"
            )
        raise UserError(
            f"{image} cannot be used",
            why,
            "give whole pictures of that camera, and the robot's configuration by --robot",
        ) from error


def _strip_pixels(
    reduced: list[Image], boxes: list[tuple[Box, ...]], cameras: Cameras, camera: Camera
) -> Image:
    """Pixels (n, 3) of strips in all the pictures: those in boxes, or of each one's best blob."""
    geometry = StripGeometry(cameras, camera)
    chosen = []
    for picture, given in zip(reduced, boxes, strict=True):
        chosen += [strip_colour.pixels_in_box(picture, box) for box in given]
        if not given:
            chosen.append(strip_colour.pixels_of_best_blob(picture, cameras.strip, geometry))
    return np.concatenate(chosen)


def _lines(strip: Strip) -> str:
    if strip.pattern == "two_colours":
        return "A strip of two colours has no colour to learn. What is found in the pictures:"
    values = "\n".join(f"{name} = {getattr(strip, name)}" for name in LEARNT)
    return f'The lines of robot.toml:\n\n[camera.strip]\npattern = "one_colour"\n{values}'


def _summary(blobs: Sequence[Blob]) -> str:
    kept = sum(blob.kept for blob in blobs)
    dropped = Counter(blob.reason for blob in blobs if not blob.kept)
    said = f"{kept} strip{'' if kept == 1 else 's'}"
    if dropped:
        said += ", dropped: " + ", ".join(f"{name} {n}" for name, n in sorted(dropped.items()))
    return said


def _write_picture(path: Path, picture: Image) -> None:
    try:
        path.write_bytes(bytes(cv2.imencode(".png", picture)[1]))
    except OSError as error:
        raise cannot_write(path, error, "choose another with --output") from error
