"""Rendered pictures: what a fisheye camera on the robot would send of the arena, as JPEG."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np

from host.config import Camera, Cameras
from host.geometry import wrap
from host.messages import FloatArray, Image
from host.perception.lens import View
from host.simulation.pictures.blocks import Drawn, drawn
from host.simulation.pictures.painting import Painter, Sprite, lay
from host.simulation.pictures.patches import Patch, in_band, red_patches
from host.simulation.pictures.rooms import ROOMS
from host.simulation.pictures.scenery import Scenery
from host.simulation.pictures.sightings import NOTHING, Sightings, visible
from host.simulation.pictures.solids import BIN, POST, POST_TOP_M, own_faces, robot_faces
from host.simulation.world.arena import BODY_RADIUS_M
from host.simulation.world.furniture import NO_FURNITURE, Furniture

_LAMP_RAD = 0.7  # where in the room the light comes from
_NOISE_MARGIN_PX = 64
_FRAME_SPREAD_RAD = math.radians(100.0)


@dataclass(frozen=True, slots=True)
class Look:
    """How pictures look, beside what is in them.

    quality: of the JPEG. noise: std of the sensor's, of 255. pedestal: how far black is above 0, in
    that std; 2.5 show nearly all of the noise. brightness: factor on all values;
    light_spread: by how much of it the light changes from picture to picture, slowly.
    exposure_s: a rotation blurs by it. floor_patches, wall_patches: red things in the room that are
    no strips, drawn where they stay out of the band in which strips appear; in_band_share: of
    them, those that do come into it. room: a name in ROOMS. light: factors on (blue, green, red)
    of lamps for which the camera's white balance is not set. fringe: by how much of the distance
    from the centre a lens draws red farther out than green, and blue farther in.
    """

    quality: int = 75
    noise: float = 3.0
    pedestal: float = 2.5
    brightness: float = 1.0
    light_spread: float = 0.15
    exposure_s: float = 0.008
    floor_patches: int = 4
    wall_patches: int = 4
    in_band_share: float = 0.0
    room: str = "plain"
    light: tuple[float, float, float] = (1.0, 1.0, 1.0)
    fringe: float = 0.0


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What is around the robot at one time.

    teammates (n, 2) and posts (m, 2) m, furniture, and red bins (k, 2) m, in the robot frame;
    pose (3,): the robot's own x, y (m) and heading (rad) in the room; turn_rate_radps: how fast it
    rotates.
    """

    teammates: FloatArray
    posts: FloatArray
    pose: FloatArray
    half_side_m: float
    turn_rate_radps: float = 0.0
    furniture: Furniture = NO_FURNITURE
    bins: FloatArray = field(default_factory=lambda: NOTHING)


class Renderer:
    """Makes the pictures of one camera. The same seed and numbers give the same pictures.

    camera: its strip and ranges are used. The room's walls, floor and red patches are the seed's.
    """

    def __init__(
        self, cameras: Cameras, camera: Camera, look: Look | None = None, seed: int = 0
    ) -> None:
        self.view = View(camera)
        self._cameras = cameras
        self._look = look or Look()
        self._seed = seed
        self._painter = Painter(self.view)
        self._own = self._painter.sprite(own_faces(), np.zeros(3))
        self._noise = self._make_noise()
        self._half_side_m = math.nan
        self._scenery: Scenery
        self._patches: list[Patch]

    def render(self, scene: Surroundings, number: int) -> bytes:
        """Return the JPEG of the scene; `number` counts pictures."""
        return encode_jpeg(self.picture(scene, number), self._look.quality)

    def picture(self, scene: Surroundings, number: int) -> Image:
        """Return the picture (height, width, 3), blue first, before compression."""
        self._enter_room(scene.half_side_m)
        random = np.random.default_rng([self._seed, number])
        gain = self._gain(number, random)
        turn_rad = scene.turn_rate_radps * self._look.exposure_s
        canvas = self._scenery.picture(scene.pose, turn_rad, gain)
        for sprite in self._sprites(scene, turn_rad):
            lay(canvas, sprite, gain)
        if self._own is not None:
            lay(canvas, self._own, gain)
        canvas = self._through_lens(canvas)
        self._add_noise(canvas, random)
        return canvas

    def _through_lens(self, canvas: Image) -> Image:
        """The canvas (h, w, 3) in the lamps' light, with the lens' fringes of colour."""
        look, camera = self._look, self.view.lens.camera
        if look.light != (1.0, 1.0, 1.0):
            canvas = np.asarray(cv2.transform(canvas, np.diag(look.light)), dtype=np.uint8)
        if look.fringe:
            centre = np.array([camera.centre_x_px, camera.centre_y_px])
            size = (camera.width_px, camera.height_px)
            for channel, sign in ((0, -1.0), (2, 1.0)):
                scale = 1.0 + sign * look.fringe
                map_ = np.column_stack((scale * np.eye(2), (1.0 - scale) * centre))
                moved = cv2.warpAffine(canvas[..., channel], map_, size, flags=cv2.INTER_LINEAR)
                canvas[..., channel] = moved
        return canvas

    def _enter_room(self, half_side_m: float) -> None:
        if half_side_m == self._half_side_m:
            return
        random = np.random.default_rng([self._seed, round(1000.0 * half_side_m)])
        look = self._look
        self._scenery = Scenery(self.view, half_side_m, random, ROOMS[look.room])
        self._patches = red_patches(
            half_side_m, look.floor_patches, look.wall_patches, look.in_band_share, random
        )
        self._half_side_m = half_side_m

    def _sprites(self, scene: Surroundings, turn_rad: float) -> Iterator[Sprite]:
        """Everything in the room that has edges, the farthest first."""
        viewpoint = self.view.origin
        lamp = _LAMP_RAD - float(scene.pose[2])
        for patch in self._patches:
            face = patch.face(scene.pose)
            if patch.in_band or not in_band(face.corners - viewpoint, self._cameras, viewpoint[2]):
                sprite = self._painter.sprite([face], face.corners.mean(axis=0), turn_rad)
                if sprite is not None:
                    yield sprite
        for _, faces, middle in sorted(
            self._things(scene, viewpoint, lamp), key=lambda thing: -thing[0]
        ):
            sprite = self._painter.sprite(faces, middle, turn_rad)
            if sprite is not None:
                yield sprite

    def _things(self, scene: Surroundings, viewpoint: FloatArray, lamp: float) -> Iterator[Drawn]:
        """Teammates, posts, bins and furniture, each with its distance."""
        strip = self._cameras.strip
        for place in scene.teammates:
            faces = robot_faces(strip, place, viewpoint, lamp)
            yield math.hypot(*(place - viewpoint[:2])), faces, np.append(place, strip.height_m)
        for place in scene.posts:
            faces = POST.faces(place, viewpoint, lamp)
            yield math.hypot(*(place - viewpoint[:2])), faces, np.append(place, 0.5 * POST_TOP_M)
        for place in scene.bins:
            faces = BIN.faces(place, viewpoint, lamp)
            yield math.hypot(*(place - viewpoint[:2])), faces, np.append(place, 0.5 * BIN.top_m)
        yield from drawn(scene.furniture, viewpoint, lamp)

    def _gain(self, number: int, random: np.random.Generator) -> float:
        """How bright picture `number` is: lamps and clouds, and a little flicker."""
        phase = 2.0 * math.pi * np.array([number / 97.0, number / 23.0]) + self._seed
        slow = 0.7 * math.sin(phase[0]) + 0.3 * math.sin(phase[1])
        flicker = 0.1 * float(random.standard_normal())
        return self._look.brightness * math.exp(self._look.light_spread * (slow + flicker))

    def _make_noise(self) -> Image:
        """Sensor noise above its least; pictures take it at random places."""
        camera = self.view.lens.camera
        shape = (camera.height_px + _NOISE_MARGIN_PX, camera.width_px + _NOISE_MARGIN_PX, 3)
        random = np.random.default_rng([self._seed, 0])
        noise = self._look.noise * (
            random.standard_normal(shape, dtype=np.float32) + self._look.pedestal
        )
        return np.asarray(np.rint(np.clip(noise, 0, 255)), dtype=np.uint8)

    def _add_noise(self, canvas: Image, random: np.random.Generator) -> None:
        x, y = random.integers(0, _NOISE_MARGIN_PX, 2)
        height, width = canvas.shape[:2]
        cv2.add(canvas, self._noise[y : y + height, x : x + width], dst=canvas)


def encode_jpeg(picture: Image, quality: int) -> bytes:
    """Return the picture (h, w, 3) as a JPEG of this quality, 1 to 100."""
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return bytes(data)


def frames(
    count: int,
    seed: int,
    cameras: Cameras | None = None,
    camera: Camera | None = None,
    look: Look | None = None,
    teammates: int = 3,
    posts: int = 2,
    ranges_m: tuple[float, float] = (0.4, 3.0),
    turn_rate_radps: float = 1.0,
    beside_bin: bool = False,
) -> Iterator[tuple[bytes, Sightings]]:
    """Yield `count` pictures (JPEG) of random scenes and what is actually visible in each.

    The teammates stand at `ranges_m` from the camera, anywhere within 100 deg of its heading. The
    robot rotates by up to `turn_rate_radps`. camera: the front one of `cameras` where not given.
    beside_bin: a red bin stands 30 deg beside the first teammate, 0.5 m from the camera, if the
    place is free.
    """
    cameras = cameras or Cameras()
    camera = camera or cameras.front
    renderer = Renderer(cameras, camera, look, seed)
    random = np.random.default_rng([seed, count, 1])
    half_side = ranges_m[1] + 0.6
    for number in range(count):
        pose = np.append(random.uniform(-0.2, 0.2, 2), random.uniform(-math.pi, math.pi))
        things = _scatter(teammates, posts, camera, ranges_m, random)
        turn_rate = random.uniform(-turn_rate_radps, turn_rate_radps)
        bins = _beside(things, camera) if beside_bin else NOTHING
        scene = Surroundings(
            things[:teammates], things[teammates:], pose, half_side, turn_rate, bins=bins
        )
        jpeg = renderer.render(scene, number)
        yield jpeg, visible(renderer.view, cameras.strip, scene.teammates, scene.posts, bins=bins)


def _beside(things: FloatArray, camera: Camera) -> FloatArray:
    """The place (1, 2) m of the bin beside the first of `things` (n, 2); none where it is taken."""
    place = np.array([camera.x_m, camera.y_m])
    x, y = things[0] - place
    bearing = math.atan2(y, x)
    inward = math.copysign(math.radians(30.0), wrap(camera.heading_rad - bearing))
    place += 0.5 * np.array([math.cos(bearing + inward), math.sin(bearing + inward)])
    apart = np.hypot(*(things - place).T).min()
    return place[None] if apart > BODY_RADIUS_M + BIN.radius_m else NOTHING


def _scatter(
    teammates: int,
    posts: int,
    camera: Camera,
    ranges_m: tuple[float, float],
    random: np.random.Generator,
) -> FloatArray:
    """Places (n + m, 2) m of teammates, then posts, in the robot frame, apart from each other."""
    places = np.zeros((0, 2))
    own = np.zeros((1, 2))
    while len(places) < teammates + posts:
        distance = random.uniform(*ranges_m)
        bearing = camera.heading_rad + random.uniform(-1.0, 1.0) * _FRAME_SPREAD_RAD
        place = np.array([[math.cos(bearing), math.sin(bearing)]]) * distance + (
            camera.x_m,
            camera.y_m,
        )
        others = np.concatenate((own, places))
        if np.all(np.hypot(*(others - place).T) > 2.0 * BODY_RADIUS_M):
            places = np.concatenate((places, place))
    return places
