"""What stands in the arena, as a camera on the robot sees it: flat faces with colours.

Faces are in the robot frame (m). Colours are (blue, green, red), 0 to 255, at full light.
"""

import colorsys
import math
from dataclasses import dataclass, replace

import numpy as np

from host.config import Strip
from host.messages import BoolArray, FloatArray
from host.perception.strips.geometry import GREEN_RGB, MAGENTA_RGB
from host.simulation.world.arena import TURRET_RADIUS_M

Colour = tuple[float, float, float]

RED: Colour = (38.0, 30.0, 190.0)
POST_TOP_M = 0.4
BODY_TOP_M = 0.12
MAST_TOP_M = 0.3
_BODY = (0.1, 0.02)  # a round body of the Cherokey's area, and its ground clearance
_MAST_RADIUS_M = 0.02
_DARK: Colour = (44.0, 42.0, 40.0)
_GREY: Colour = (52.0, 50.0, 48.0)
_BLACK: Colour = (26.0, 25.0, 25.0)
_WOOD: Colour = (150.0, 172.0, 184.0)
_FACETS = 6  # around the visible half; twice as many where it is wide
_WIDE_M = 0.04
_STRAIGHT_RAD = 0.06
_AMBIENT = 0.8  # of the light; the rest comes from one side


@dataclass(frozen=True, slots=True)
class Face:
    """A flat polygon, (k, 3) m, and the colour that it shows."""

    corners: FloatArray
    colour: Colour


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder: radius, bottom and top (m above the floor), colours of coat and lid."""

    radius_m: float
    bottom_m: float
    top_m: float
    colour: Colour
    lid: Colour

    def arc(self, axis: FloatArray, viewpoint: FloatArray, places: FloatArray) -> FloatArray:
        """Angles (k,) rad about the axis (2,) of places on the coat that `viewpoint` (3,) sees.

        places (k,): -1 is the left rim as seen from there, 0 what faces it, 1 the right rim.
        Empty where the viewpoint is inside.
        """
        x, y = viewpoint[:2] - axis
        distance = math.hypot(x, y)
        if distance <= self.radius_m:
            return np.zeros(0)
        half = math.acos(self.radius_m / distance)
        return np.asarray(math.atan2(y, x) + half * places)

    def rims(self, axis: FloatArray, angles: FloatArray, heights: FloatArray) -> FloatArray:
        """Points (k, m, 3) on the coat at `angles` (k,) rad about the axis and heights (m,) m."""
        points = np.empty((len(angles), len(heights), 3))
        points[..., 0] = (axis[0] + self.radius_m * np.cos(angles))[:, None]
        points[..., 1] = (axis[1] + self.radius_m * np.sin(angles))[:, None]
        points[..., 2] = heights
        return points

    def faces(self, axis: FloatArray, viewpoint: FloatArray, light_rad: float) -> list[Face]:
        """Return what `viewpoint` sees of the cylinder: its lid from above, and facets of its coat.

        light_rad: the direction, in the robot frame, from which the lamp shines.
        """
        faces: list[Face] = []
        count = 2 * _FACETS if self.radius_m > _WIDE_M else _FACETS
        if viewpoint[2] > self.top_m:
            around = np.linspace(0.0, 2.0 * math.pi, 4 * count, endpoint=False)
            faces.append(Face(self.rims(axis, around, np.array([self.top_m]))[:, 0], self.lid))
        angles = self.arc(axis, viewpoint, np.linspace(-1.0, 1.0, count + 1))
        if not len(angles):
            return faces
        heights = np.linspace(self.top_m, self.bottom_m, 1 + self._pieces(axis, viewpoint))
        rims = self.rims(axis, angles, heights)
        corners = np.concatenate((rims[:-1], rims[1:, ::-1]), axis=1)
        toward = np.cos(0.5 * (angles[:-1] + angles[1:]) - light_rad)
        shades = _AMBIENT + (1.0 - _AMBIENT) * np.maximum(toward, 0.0)
        return faces + [
            Face(facet, lit(self.colour, float(light)))
            for facet, light in zip(corners, shades, strict=True)
        ]

    def _pieces(self, axis: FloatArray, viewpoint: FloatArray) -> int:
        """How many straight pieces an upright line needs where a fisheye bends it."""
        distance = math.hypot(*(viewpoint[:2] - axis))
        return min(1 + int((self.top_m - self.bottom_m) / distance / _STRAIGHT_RAD), 20)

    def between(self, axis: FloatArray, viewpoint: FloatArray, points: FloatArray) -> BoolArray:
        """Which `points` (k, 3) the cylinder hides from `viewpoint` (3,)."""
        start = viewpoint[:2] - axis
        way = points - viewpoint
        square = np.einsum("ki,ki->k", way[:, :2], way[:, :2])
        half = way[:, :2] @ start
        rest = half**2 - square * (start @ start - self.radius_m**2)
        root = np.sqrt(np.maximum(rest, 0.0))
        enters = np.maximum((-half - root) / square, 0.0)
        leaves = np.minimum((-half + root) / square, 1.0)
        heights = viewpoint[2] + np.stack((enters, leaves)) * way[:, 2]
        hides: BoolArray = (
            (rest > 0.0)
            & (enters < leaves)
            & (heights.max(axis=0) > self.bottom_m)
            & (heights.min(axis=0) < self.top_m)
        )
        return hides


def strip_of(strip: Strip) -> Cylinder:
    """The strip's coat on its robot: red, or of the hue that is looked for instead."""
    half = 0.5 * strip.tall_m
    colour = _rotated(RED, strip.hue_deg)
    return Cylinder(
        0.5 * strip.diameter_m, strip.height_m - half, strip.height_m + half, colour, _DARK
    )


def bands_of(strip: Strip) -> tuple[Cylinder, ...]:
    """The strip's coat in its colours: one band, or green over magenta."""
    coat = strip_of(strip)
    if strip.pattern == "one_colour":
        return (coat,)
    return (
        replace(coat, bottom_m=strip.height_m, colour=_bgr(GREEN_RGB)),
        replace(coat, top_m=strip.height_m, colour=_bgr(MAGENTA_RGB)),
    )


def robot_of(strip: Strip) -> tuple[Cylinder, ...]:
    """A teammate without its strip: body, the turret under the strip, a mast on it."""
    coat = strip_of(strip)
    radius, clearance = _BODY
    turret_top = max(coat.bottom_m, BODY_TOP_M)
    return (
        Cylinder(radius, clearance, BODY_TOP_M, _DARK, _GREY),
        Cylinder(TURRET_RADIUS_M, BODY_TOP_M, turret_top, _BLACK, _BLACK),
        Cylinder(_MAST_RADIUS_M, coat.top_m, max(MAST_TOP_M, coat.top_m), _DARK, _GREY),
    )


POST = Cylinder(TURRET_RADIUS_M, 0.0, POST_TOP_M, _WOOD, _WOOD)
BIN = Cylinder(0.08, 0.0, 0.45, RED, RED)  # as tall as a fire extinguisher, and as red


def robot_faces(
    strip: Strip, position: FloatArray, viewpoint: FloatArray, light_rad: float
) -> list[Face]:
    """Return a teammate at `position` (2,), in the order in which to paint it."""
    # Of two parts, one on the other, the one nearer to the viewpoint's height covers the other.
    parts = sorted(
        (*robot_of(strip), *bands_of(strip)),
        key=lambda part: -max(part.bottom_m - viewpoint[2], viewpoint[2] - part.top_m, 0.0),
    )
    return [face for part in parts for face in part.faces(position, viewpoint, light_rad)]


def own_faces() -> list[Face]:
    """The robot's own body from above, a Cherokey's: plate, board, and two red connectors."""
    return [
        _plate((-0.1125, 0.1125), (-0.0875, 0.0875), BODY_TOP_M, _DARK),
        _plate((-0.045, 0.045), (-0.07, 0.07), BODY_TOP_M, (96.0, 60.0, 36.0)),
        _plate((0.09, 0.1), (0.03, 0.05), BODY_TOP_M, RED),
        _plate((-0.1, -0.09), (-0.05, -0.03), BODY_TOP_M, RED),
    ]


def _plate(x: tuple[float, float], y: tuple[float, float], z: float, colour: Colour) -> Face:
    """A level rectangle; its sides have corners in between, for a fisheye bends them."""
    share = np.linspace(0.0, 1.0, 12, endpoint=False)
    sides = [
        np.stack((ax + share * (bx - ax), ay + share * (by - ay)), axis=1)
        for (ax, ay), (bx, by) in (
            ((x[0], y[0]), (x[1], y[0])),
            ((x[1], y[0]), (x[1], y[1])),
            ((x[1], y[1]), (x[0], y[1])),
            ((x[0], y[1]), (x[0], y[0])),
        )
    ]
    level = np.concatenate(sides)
    return Face(np.column_stack((level, np.full(len(level), z))), colour)


def shade(angle_rad: float) -> float:
    """How brightly a side is lit that looks away from the lamp's direction by an angle."""
    return _AMBIENT + (1.0 - _AMBIENT) * max(math.cos(angle_rad), 0.0)


def lit(colour: Colour, light: float) -> Colour:
    """Return the colour at a share `light` of full light."""
    blue, green, red = colour
    return light * blue, light * green, light * red


def _bgr(rgb: tuple[int, int, int]) -> Colour:
    red, green, blue = rgb
    return float(blue), float(green), float(red)


def _rotated(colour: Colour, hue_deg: float) -> Colour:
    """The colour with its hue so much further round the circle."""
    hue, saturation, value = colorsys.rgb_to_hsv(*colour[::-1])
    red, green, blue = colorsys.hsv_to_rgb((hue + hue_deg / 360.0) % 1.0, saturation, value)
    return blue, green, red
