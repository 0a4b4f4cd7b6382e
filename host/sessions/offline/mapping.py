"""`swarmloc map`: a map of a source, with teammates and without, and how wrong each is."""

from dataclasses import asdict, dataclass

import numpy as np

from host.config import RobotConfig
from host.errors import UserError
from host.estimator import profiles
from host.geometry import to_parent
from host.localizer import Localizer
from host.mapping.grid import OccupancyGrid
from host.mapping.mapper import Mapper
from host.messages import (
    Bearings,
    Displacement,
    FloatArray,
    Measurement,
    Positions,
    Scan,
)
from host.sessions.recordings import runs
from host.simulation.offline import OBSERVER, Simulation
from host.simulation.world.arena import TURRET_RADIUS_M, Arena
from host.simulation.world.furniture import nearest_points
from host.simulation.world.scenarios import Scenario

_NEAR_M = 0.1  # an occupied cell this near to something that stands there is right


@dataclass(frozen=True, slots=True)
class WrongCells:
    """Of one map: cells that are known in the room, and how many of them are wrong.

    false: occupied, and nothing stands within 10 cm. lost: free, and the middle is inside of
    something that stands there.
    """

    known: int
    false: int
    lost: int

    @property
    def wrong(self) -> int:
        """All of them."""
        return self.false + self.lost

    def as_json(self) -> dict[str, int]:
        """As JSON values."""
        return {**asdict(self), "wrong": self.wrong}


def map_source(
    source: str, filter_name: str, cell_m: float, robot: RobotConfig | None = None
) -> tuple[Mapper, dict[str, WrongCells]]:
    """Maps of a recording or scenario; how wrong they are, where the room is known: a scenario's.

    Raises UserError where there is no source, or no scan in it.
    """
    found = runs.find_source(source)
    if isinstance(found, Scenario):
        run = runs.simulate_scenario(source, robot)
    else:
        run = runs.load_recording(source, robot)
    mapper = _mapped(run, filter_name, cell_m)
    if mapper.first is None:
        raise UserError(
            f"{source} cannot be mapped",
            "there is no scan in it with enough returns",
            "see that the lidar was in use: swarmloc doctor",
        )
    if not isinstance(found, Scenario):
        return mapper, {}
    arena = Simulation(found, run.config).arena
    start = arena.poses(np.array([mapper.first]))[0, OBSERVER]
    grids = {"with teammates": mapper.whole, "without teammates": mapper.cleared}
    return mapper, {name: wrong_cells(grid, arena, start) for name, grid in grids.items()}


def _mapped(run: runs.Run, filter_name: str, cell_m: float) -> Mapper:
    mapper = Mapper(run.config.lidar, cell_m)
    filter_ = profiles.make(filter_name, run.config)

    def used(measured: Measurement, _: Positions | Bearings) -> None:
        if isinstance(measured, Scan):
            mapper.take(measured, filter_.estimate().positions)

    localizer = Localizer(run.config, filter_, used)
    for message in run.messages:
        if isinstance(message, Displacement):
            mapper.move(message)
        localizer.handle(message)
    localizer.finish()
    return mapper


def wrong_cells(grid: OccupancyGrid, arena: Arena, start: FloatArray) -> WrongCells:
    """What of a map is wrong. start (3,): where its origin is in the arena."""
    occupied, free = to_parent(grid.occupied, start), to_parent(grid.free, start)
    inside = np.abs(free).max(axis=1) < arena.half_side_m
    away = _from_solid(occupied, arena)
    return WrongCells(
        known=int(len(occupied) + inside.sum()),
        false=int(np.sum(away > _NEAR_M)),
        lost=int(np.sum(_from_solid(free[inside], arena) <= 0.0)),
    )


def _from_solid(points: FloatArray, arena: Arena) -> FloatArray:
    """How far (n,) m points (n, 2) of the arena are from walls, posts and furniture; 0: inside."""
    furniture = arena.furniture
    rounds = np.concatenate((arena.posts, furniture.legs))
    radii = np.concatenate((np.full(len(arena.posts), TURRET_RADIUS_M), furniture.leg_radii))
    to_rounds = np.linalg.norm(points[:, None] - rounds, axis=2) - radii
    to_boxes = np.linalg.norm(nearest_points(furniture.boxes, points) - points[:, None], axis=2)
    walls = np.abs(arena.half_side_m - np.abs(points)).min(axis=1)
    return np.asarray(np.min(np.column_stack((to_rounds, to_boxes, walls)), axis=1))
