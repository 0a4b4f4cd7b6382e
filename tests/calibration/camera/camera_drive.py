"""A drive with two fisheye cameras, made up apart from the code under test.

Its lens is in no family of the fit's: t + a t^3 + b t^5 + c t^7, as the maker of one might grind
it. The observer wanders and turns both ways; teammates go around it, near and far.
"""

import dataclasses
import math

import numpy as np
from scipy.spatial.transform import Rotation

from host.calibration.gathered import Gathered
from host.config import Camera, Cameras, RobotConfig
from host.messages import Bearings, Bodies, BoolArray, Displacement, FloatArray, Scan
from host.perception.lens import View

STRIP_M = 0.2
MOCAP_HZ = 100.0
TURN_S = 0.14


@dataclasses.dataclass(frozen=True)
class Ground:
    """A true camera: lens (focal length, a, b, c), centre, mounting in degrees, place in m."""

    focal: float
    terms: tuple[float, float, float]
    centre: tuple[float, float]
    mount_deg: tuple[float, float, float]
    place: tuple[float, float, float]

    def pixels(self, points: FloatArray) -> FloatArray:
        heading, tilt, roll = self.mount_deg
        # Camera axes of a level camera that looks along x: right is -y, down is -z.
        level = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        turn = Rotation.from_euler("ZYX", [heading, tilt, roll], degrees=True)
        rays = turn.inv().apply(points - np.array(self.place)) @ level.T
        angle = np.arccos(rays[:, 2] / np.linalg.norm(rays, axis=1))
        a, b, c = self.terms
        radius = self.focal * (angle + a * angle**3 + b * angle**5 + c * angle**7)
        around = np.arctan2(rays[:, 1], rays[:, 0])
        drawn = np.stack((np.cos(around), np.sin(around)), axis=1) * radius[:, None]
        return np.where((angle < 1.9)[:, None], drawn + np.array(self.centre), math.nan)


FRONT = Ground(
    622.0, (-0.03, -0.004, 0.0011), (968.0, 529.0), (3.0, 43.0, -1.2), (0.03, 0.012, 0.257)
)
REAR = Ground(
    601.0, (0.02, -0.006, 0.0007), (951.0, 548.0), (178.0, 47.0, 0.8), (-0.034, -0.01, 0.246)
)
GROUND = {"front": FRONT, "rear": REAR}


def seen_middle(camera: Ground, place: FloatArray) -> FloatArray:
    """Pixel (2,) of the middle of what is seen of a strip: of its near half, by solid angle."""
    strip = RobotConfig().camera.strip
    angles = (np.arange(60) + 0.5) / 60 * math.pi - 0.5 * math.pi
    facing = math.atan2(camera.place[1] - place[1], camera.place[0] - place[0])
    heights = STRIP_M + ((np.arange(20) + 0.5) / 20 - 0.5) * strip.tall_m
    normals = np.stack((np.cos(angles + facing), np.sin(angles + facing)), axis=1)
    points = np.zeros((60, 20, 3))
    points[..., :2] = (place[:2] + 0.5 * strip.diameter_m * normals)[:, None]
    points[..., 2] = heights
    rays = points - np.array(camera.place)
    away = np.linalg.norm(rays, axis=2)
    solid = np.maximum(-np.einsum("amk,ak->am", rays[..., :2], normals), 0.0) / away**3
    elevations = np.arctan2(rays[..., 2], np.hypot(rays[..., 0], rays[..., 1]))
    level = float(np.average(elevations, weights=solid))
    # To both sides of the facing line a coat is alike.
    ray = np.array([[-math.cos(facing), -math.sin(facing), math.tan(level)]])
    return np.asarray(camera.pixels(np.array(camera.place) + ray)[0])


def shown(pixels: FloatArray) -> BoolArray:
    x, y = pixels.T
    return (x > 0.0) & (x < 1919.0) & (y > 0.0) & (y < 1079.0)


@dataclasses.dataclass(frozen=True)
class Drive:
    """Where all robots are, by time: the observer first, two teammates around it.

    ahead: teammates stay within 55 deg ahead. turning: False for an observer that spins steadily.
    """

    seconds: float = 120.0
    ahead: bool = False
    turning: bool = True

    def poses(self, times: FloatArray) -> FloatArray:
        """(k, 3 robots, 3)."""
        t = np.asarray(times, dtype=float)
        x, y = 0.5 * np.sin(0.31 * t), 0.4 * np.sin(0.23 * t + 1.0)
        heading = 0.9 * np.sin(0.7 * t) + 0.5 * np.sin(1.9 * t + 0.4) if self.turning else 0.8 * t
        if not self.turning:
            x, y = np.zeros(len(t)), np.zeros(len(t))
        robots = [np.stack((x, y, heading), axis=1)]
        for k, (rate, sign) in enumerate(((0.045, 1.0), (0.031, -1.0))):
            reach = 1.15 + 0.75 * np.sin((0.21 + 0.08 * k) * t + 2.0 * k)
            around = sign * math.tau * rate * t + 2.5 * k
            if self.ahead:
                around = heading + np.radians(55.0) * np.sin(3.0 * math.tau * rate * t + k)
            if not self.turning:
                reach, around = np.full(len(t), 0.8 + k), np.full(len(t), 2.0 * k)
            away = np.stack((reach * np.cos(around), reach * np.sin(around)), axis=1)
            mate = robots[0][:, :2] + away
            robots.append(np.column_stack((mate, np.zeros(len(t)))))
        return np.stack(robots, axis=1)

    def relative(self, times: FloatArray) -> FloatArray:
        """(k, 2 teammates, 2) m in the observer's frame, by complex numbers."""
        poses = self.poses(times)
        where = poses[..., 0] + 1j * poses[..., 1]
        off = (where[:, 1:] - where[:, :1]) * np.exp(-1j * poses[:, :1, 2])
        return np.stack((off.real, off.imag), axis=-1)


def gather(
    drive: Drive,
    *,
    pairs: int = 500,
    wrong: float = 0.2,
    noise_px: float = 1.0,
    delay_s: float = 0.15,
    seed: int = 0,
    mocap: bool = True,
    lidar_noise_m: float | None = None,
    camera: Cameras | None = None,
) -> Gathered:
    """A recording of so many strips at even times, a share of which nobody wears.

    Time stamps are late by `delay_s`; the configuration is the default's, with a delay of 0.
    """
    rng = np.random.default_rng(seed)
    config = RobotConfig(camera=camera or Cameras(delay_s=0.0))
    gathered = Gathered(config)
    times = np.sort(rng.uniform(0.5, drive.seconds - 0.5, pairs))
    mates = drive.relative(times)
    for time, places in zip(times, mates, strict=True):
        place = places[rng.integers(len(places))]
        eye = "front" if place[0] > 0.0 else "rear"
        pixel = seen_middle(GROUND[eye], place)
        pixel = pixel + rng.normal(0.0, noise_px, 2)
        if rng.random() < wrong or not shown(pixel[None])[0]:
            eye = str(rng.choice(["front", "rear"]))
            pixel = np.array([rng.uniform(0.0, 1919.0), rng.uniform(0.0, 1000.0)])
        gathered.take(_bearings(config.camera, eye, float(time) + delay_s, pixel))
    if mocap:
        frames = np.arange(0.0, drive.seconds, 1.0 / MOCAP_HZ)
        for time, poses in zip(frames, drive.poses(frames), strict=True):
            gathered.take(Bodies(float(time), np.arange(1, 4), poses))
    if lidar_noise_m is not None:
        _add_lidar(gathered, drive, lidar_noise_m, rng)
    return gathered


def _bearings(camera: Cameras, eye: str, time: float, pixel: FloatArray) -> Bearings:
    configured: Camera = getattr(camera, eye)
    across = (configured.centre_x_px - pixel[0]) / configured.focal_px
    bearing = np.array([configured.heading_rad + across])  # as rough as it may be
    return Bearings(time, bearing, np.array([1e-3]), camera=eye, pixels=pixel[None])


def _add_lidar(gathered: Gathered, drive: Drive, noise_m: float, rng: np.random.Generator) -> None:
    """Turns of 720 samples that hit two turrets of 65 mm, and the wheels' exact displacements."""
    radius = 0.5 * gathered.config.lidar.target_diameter_m
    angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)
    for end in np.arange(TURN_S, drive.seconds, TURN_S):
        times = end - TURN_S * (1.0 - np.arange(1, 721) / 720)
        ranges = np.zeros(720)
        # One error for each turret and turn: it is the centre that a turn tells.
        places = drive.relative(times) + rng.normal(0.0, noise_m, (1, 2, 2))
        for mate in (places[:, 0], places[:, 1]):
            along = mate[:, 0] * np.cos(angles) + mate[:, 1] * np.sin(angles)
            across = mate[:, 1] * np.cos(angles) - mate[:, 0] * np.sin(angles)
            hit = (np.abs(across) < radius) & (along > 0.0)
            near = along[hit] - np.sqrt(radius**2 - across[hit] ** 2)
            ranges[hit] = np.where(ranges[hit] > 0.0, np.minimum(ranges[hit], near), near)
        gathered.take(Scan(float(end), times, angles, ranges))
    steps = np.arange(0.0, drive.seconds, 0.02)
    own = drive.poses(steps)[:, 0]
    for before, after, end in zip(own[:-1], own[1:], steps[1:], strict=True):
        step = (after[0] - before[0] + 1j * (after[1] - before[1])) * np.exp(-1j * before[2])
        turn = float(after[2] - before[2])
        gathered.take(Displacement(float(end), 0.02, float(step.real), float(step.imag), turn))


def bearing_errors_deg(camera: Cameras) -> FloatArray:
    """Errors of bearings by a configuration, all around, for strips at 0.5, 1 and 2 m."""
    found = []
    for reach in (0.5, 1.0, 2.0):
        around = np.radians(np.arange(-180.0, 180.0, 1.0))
        points = np.stack(
            (reach * np.cos(around), reach * np.sin(around), np.full(360, STRIP_M)), axis=1
        )
        for name, mine in (("front", points[:, 0] > 0.0), ("rear", points[:, 0] <= 0.0)):
            eye: Camera = getattr(camera, name)
            pixels = GROUND[name].pixels(points[mine])
            visible = shown(pixels)
            rays = View(eye).directions_of(pixels[visible])
            off = points[mine][visible] - np.array([eye.x_m, eye.y_m, 0.0])
            wanted = off[:, 0] + 1j * off[:, 1]
            found.append(np.angle((rays[:, 0] + 1j * rays[:, 1]) / wanted, deg=True))
    return np.abs(np.concatenate(found))
