"""`swarmloc calibrate colour`: the colour of the teammates' strips, learnt from pictures."""

import dataclasses
from collections import Counter
from pathlib import Path

import click
import cv2
import numpy as np

from host.calibration.camera import colour as strip_colour
from host.calibration.camera.colour import Box
from host.cli.options import json_option, robot_option, write_json
from host.config import Camera, Cameras, Strip
from host.errors import UserError
from host.messages import Image
from host.perception.blob import Blob
from host.perception.jpeg_decoder import UnusableError, decode, size_of
from host.perception.strip_geometry import StripGeometry
from host.perception.strips import StripFinder
from host.sessions.robot import robot_configuration

_LEARNT = ("hue_deg", "hue_width_deg", "saturation_min", "value_min")


def _boxes(_context: click.Context, _option: click.Parameter, texts: tuple[str, ...]) -> list[Box]:
    """Each text as four whole numbers. Raises a usage error for one that is no box."""
    boxes = []
    for text in texts:
        try:
            x, y, width, height = (int(part) for part in text.split(","))
        except ValueError as error:
            raise click.BadParameter(f"{text!r} is not like 840,130,60,30.") from error
        if min(x, y) < 0 or min(width, height) < 1:
            raise click.BadParameter(f"{text!r}: x, y from 0 on, width and height from 1 on.")
        boxes.append((x, y, width, height))
    return boxes


@click.command()
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--box",
    "boxes",
    callback=_boxes,
    multiple=True,
    metavar="X,Y,W,H",
    help="Box around a strip, in pixels; one for each picture.  [default: the most saturated blob]",
)
@click.option(
    "--eye",
    "camera_name",
    type=click.Choice(["front", "rear"]),
    default="front",
    show_default=True,
    help="Camera that took the pictures.",
)
@robot_option
@click.option(
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("annotated.png"),
    show_default=True,
    help="Picture of what would be detected; more of them get -2, -3, ...",
)
@json_option
def colour(
    images: tuple[Path, ...],
    boxes: list[Box],
    camera_name: str,
    robot_path: Path | None,
    output: Path,
    json_path: Path | None,
) -> None:
    """Learn the colour of the teammates' strips from a few pictures of the camera.

    \b
    Example, with a box around the strip in the one picture:
      swarmloc calibrate colour front.jpg --box 840,130,60,30
    """
    if boxes and len(boxes) != len(images):
        raise click.BadParameter(
            f"{len(boxes)} for {len(images)} picture(s): give one each, or none.",
            param_hint="--box",
        )
    cameras = robot_configuration(robot_path).camera
    camera: Camera = getattr(cameras, camera_name)
    jpegs = [strip_colour.read_picture(path) for path in images]
    pixels = _strip_pixels(images, jpegs, boxes, cameras, camera, camera_name)
    strip = cameras.strip
    if strip.pattern == "one_colour":
        strip = strip_colour.learn(pixels, strip)
    finder = StripFinder(cameras.model_copy(update={"strip": strip}), camera)
    found = [finder.search(jpeg) for jpeg in jpegs]
    pictures = [
        output,
        *(output.with_stem(f"{output.stem}-{k}") for k in range(2, len(images) + 1)),
    ]
    for path, jpeg, blobs in zip(pictures, jpegs, found, strict=True):
        _write_picture(path, strip_colour.annotate(jpeg, blobs, finder.geometry))
    click.echo(_lines(strip))
    click.echo()
    for image, path, blobs in zip(images, pictures, found, strict=True):
        click.echo(f"{image}: {_summary(blobs)}; drawn in {path}")
    write_json(
        json_path,
        {
            "strip": {name: getattr(strip, name) for name in ("pattern", *_LEARNT)},
            "pictures": [
                {
                    "image": str(image),
                    "annotated": str(path),
                    "blobs": [dataclasses.asdict(blob) for blob in blobs],
                }
                for image, path, blobs in zip(images, pictures, found, strict=True)
            ],
        },
    )


def _strip_pixels(
    images: tuple[Path, ...],
    jpegs: list[bytes],
    boxes: list[Box],
    cameras: Cameras,
    camera: Camera,
    camera_name: str,
) -> Image:
    """Pixels (n, 3) of strips in all the pictures. Raises UserError for one that is not usable."""
    geometry = StripGeometry(cameras, camera)
    chosen = []
    for k, (image, jpeg) in enumerate(zip(images, jpegs, strict=True)):
        try:
            picture = decode(jpeg, (camera.width_px, camera.height_px), camera.height_px)
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
        if boxes:
            chosen.append(strip_colour.pixels_in_box(picture, boxes[k]))
        else:
            chosen.append(strip_colour.pixels_of_best_blob(picture, cameras.strip, geometry))
    return np.concatenate(chosen)


def _lines(strip: Strip) -> str:
    if strip.pattern == "two_colours":
        return "A strip of two colours has no colour to learn. What is found in the pictures:"
    values = "\n".join(f"{name} = {getattr(strip, name)}" for name in _LEARNT)
    return f'Put these lines into robot.toml:\n\n[camera.strip]\npattern = "one_colour"\n{values}'


def _summary(blobs: list[Blob]) -> str:
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
        raise UserError(
            f"cannot write {path}", error.strerror or str(error), "choose another with --output"
        ) from error
