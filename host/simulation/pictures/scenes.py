"""Rooms, lights and cameras, by name, on which the search for strips is judged."""

from collections.abc import Iterator
from dataclasses import dataclass

from host.config import Camera, Cameras
from host.simulation.pictures.render import Look, frames
from host.simulation.pictures.sightings import Sightings

_NEAREST_M, _FARTHEST_M = 0.4, 4.0
_TEAMMATES, _POSTS = 4, 2
# Black bodies of 2700 K and 10000 K through a white balance for 5500 K, as sRGB has it.
_WARM, _COLD = (0.47, 0.78, 1.0), (1.14, 0.98, 0.87)


@dataclass(frozen=True, slots=True)
class Scene:
    """What pictures of one name have in common.

    turn_rate_radps: the robot rotates by up to so much. beside_bin: a red bin of 16 x 45 cm stands
    30 deg beside a teammate, 0.5 m from the camera.
    """

    look: Look
    turn_rate_radps: float = 1.0
    beside_bin: bool = False


SCENES = {
    "plain": Scene(Look()),
    "q50": Scene(Look(quality=50)),
    "q92": Scene(Look(quality=92)),
    "brick": Scene(Look(room="brick")),
    "carpet": Scene(Look(room="carpet")),
    "orange_floor": Scene(Look(room="orange_floor")),
    "wood": Scene(Look(room="wood")),
    "shelves": Scene(Look(room="shelves")),
    "warm": Scene(Look(room="sharp", light=_WARM)),
    "warm_wood": Scene(Look(room="wood", light=_WARM)),
    "cold": Scene(Look(room="sharp", light=_COLD)),
    "dark": Scene(Look(room="sharp", brightness=0.3, noise=10.0, pedestal=0.5)),
    "fringes": Scene(Look(room="sharp", fringe=0.0015)),
    "bin": Scene(Look(), beside_bin=True),
    "blur_10ms": Scene(Look(exposure_s=0.010), turn_rate_radps=3.0),
    "blur_20ms": Scene(Look(exposure_s=0.020), turn_rate_radps=3.0),
    "blur_33ms": Scene(Look(exposure_s=0.033), turn_rate_radps=3.0),
}


def scene_frames(
    name: str, count: int, seed: int, cameras: Cameras | None = None, camera: Camera | None = None
) -> Iterator[tuple[bytes, Sightings]]:
    """Yield `count` pictures (JPEG, 4:2:0) of a scene of SCENES, and what is actually in view.

    Four teammates and two posts stand 0.4 to 4 m from the camera. Others as in `frames`.
    """
    scene = SCENES[name]
    yield from frames(
        count,
        seed,
        cameras,
        camera,
        scene.look,
        _TEAMMATES,
        _POSTS,
        (_NEAREST_M, _FARTHEST_M),
        scene.turn_rate_radps,
        scene.beside_bin,
    )
