"""Draws docs/arena4.svg: one instant of the simulated arena4, as one of its robots knows it.

Nothing in it is made up: the scenario is simulated offline, its messages go through the localizer,
and what was measured, estimated and true at one instant is drawn in the robot's frame.

    .venv/bin/python tools/draw_scene.py > docs/arena4.svg
"""

import math

import numpy as np

from host.config import RobotConfig
from host.estimator import profiles
from host.evaluation.truth_scoring import errors_m
from host.geometry import Path, to_frame, to_parent
from host.localizer import Localizer
from host.messages import Bearings, Displacement, Estimate, FloatArray, Message, Scan, Truth
from host.sessions import runs
from host.simulation.offline import OBSERVER
from host.simulation.world import scenarios
from host.simulation.world.arena import TURRET_RADIUS_M, Arena

SCENARIO, INSTANT_S = "arena4:seed=6,seconds=60", 59.7  # drawn is the first scan that ends after it
MIDDLE, SCALE = np.array([254.0, 244.0]), 122.0  # of the arena, px; px/m
SQUARE = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
BODY_M = 0.5 * np.array([0.225, 0.175]) * SQUARE  # of a Cherokey
ARROW_M = np.array([[0.04, 0.0], [0.18, 0.0], [0.14, 0.03], [0.18, 0.0], [0.14, -0.03]])
FAR_M = 9.0  # beyond every wall

INK, SOFT, RED = "#22313a", "#5b6b73", "#c2281d"
HEADER = f"""\
<svg xmlns="http://www.w3.org/2000/svg" width="800" height="520" viewBox="0 0 800 520"
 font-family="Helvetica, Arial, sans-serif" font-size="13" fill="{INK}">
<rect width="800" height="520" fill="#fff"/>"""
WALL = 'fill="none" stroke="#b4c0c6" stroke-width="5" stroke-linejoin="round"'
BLIND = 'fill="#e8edf0"'
RAY = 'fill="none" stroke="#e0a030" stroke-width="1.2"'
LINE = f'fill="none" stroke="{INK}" stroke-width="1.3"'
OWN = f'fill="#c9d6dd" stroke="{INK}" stroke-width="1.3"'
TEAMMATE = f'fill="#fff" stroke="{INK}" stroke-width="1.3"'
ELLIPSE = f'fill="{RED}" fill-opacity="0.15" stroke="{RED}" stroke-width="1.3"'
SMALL = f'fill="{SOFT}" font-size="12"'
HALO = 'text-anchor="middle" paint-order="stroke" stroke="#fff" stroke-width="3"'

Localized = tuple[Path, list[Estimate], list[FloatArray]]  # odometry; of each scan, with errors, m


def localize(messages: list[Message], config: RobotConfig) -> Localized:
    """Run the localizer on all messages."""
    path, estimates = Path(math.inf), list[Estimate]()
    localizer = Localizer(config, profiles.make("phd", config))
    for message in messages:
        if isinstance(message, Scan | Bearings | Displacement):
            estimates += localizer.handle(message)
        if isinstance(message, Displacement):
            path.append(message)
    truths = {message.time: message for message in messages if isinstance(message, Truth)}
    estimates = [estimate for estimate in estimates if estimate.time in truths]
    return path, estimates, [errors_m(e, truths[e.time]) for e in estimates]


def returns(scan: Scan, config: RobotConfig, path: Path) -> FloatArray:
    """What the lidar saw, (n, 2) m, in the robot frame at the scan's end."""
    mounting = np.array([config.lidar.x_m, config.lidar.y_m, config.lidar.heading_rad])
    points = to_parent(scan.ranges[:, None] * unit(scan.angles), mounting)
    return path.carry(points, scan.times, scan.time)[scan.ranges > 0.0]


def rays(seen: Bearings, path: Path, to_time: float) -> FloatArray:
    """Rays along the bearings, from start to end (k, 2, 2) m, in the robot frame at `to_time`."""
    start = np.broadcast_to(seen.origin, (len(seen.bearings), 2))
    ends = np.concatenate((start, start + FAR_M * unit(seen.bearings)))
    carried = path.carry(ends, np.full(len(ends), seen.time), to_time)
    return np.stack(np.split(carried, 2), axis=1)


def unit(angles: FloatArray) -> FloatArray:
    """Unit vectors (n, 2) at angles (n,) rad."""
    return np.stack((np.cos(angles), np.sin(angles)), axis=1)


class Drawing:
    """Elements of an SVG; points (n, 2) m of the robot frame are drawn forward up."""

    def __init__(self, middle: FloatArray) -> None:
        self.parts = [HEADER]
        self._middle = middle

    def px(self, points: FloatArray) -> FloatArray:
        return MIDDLE - SCALE * (np.atleast_2d(points) - self._middle)[:, ::-1]

    def at(self, x_px: float, y_px: float) -> FloatArray:
        """The point (2,) m that is drawn at a pixel."""
        return self._middle + (MIDDLE - (x_px, y_px))[::-1] / SCALE

    def text(self, x_px: float, y_px: float, words: str, style: str = "") -> None:
        self.parts.append(f'<text x="{x_px:.1f}" y="{y_px:.1f}" {style}>{words}</text>')

    def shape(self, points: FloatArray, style: str, kind: str = "polygon") -> None:
        listed = " ".join(f"{x:.1f},{y:.1f}" for x, y in self.px(points))
        self.parts.append(f'<{kind} points="{listed}" {style}/>')

    def dots(self, points: FloatArray, radius_px: float, style: str) -> None:
        for x, y in self.px(points):
            self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius_px:.1f}" {style}/>')

    def robot(self, pose: FloatArray, style: str) -> None:
        """Outline, heading and turret of a robot at x, y (m), heading (rad)."""
        self.shape(to_parent(BODY_M, pose), style)
        self.shape(to_parent(ARROW_M, pose), LINE, "polyline")
        self.dots(pose[:2], SCALE * TURRET_RADIUS_M, style)

    def estimate(self, mean: FloatArray, covariance: FloatArray) -> None:
        circle = unit(np.linspace(0.0, math.tau, 40, endpoint=False))
        self.shape(mean + 2.0 * circle @ np.linalg.cholesky(covariance).T, ELLIPSE)
        self.dots(mean, 1.4, f'fill="{RED}"')

    def label(self, point: FloatArray, words: str, avoid: FloatArray, style: str) -> None:
        """Words beside a point (2,) m, on the side furthest from the points (n, 2) m to avoid."""
        sides = self.px(point) + np.array([[42, 4], [-42, 4], [0, -26], [0, 34]])
        x, y = max(sides, key=lambda side: np.hypot(*(self.px(avoid) - side).T).min())
        self.text(x, y, words, f"{style} {HALO}")


def picture(config: RobotConfig) -> str:
    """The scene as SVG."""
    scenario = scenarios.parse_scenario(SCENARIO)
    arena, messages = Arena(scenario), list(runs.simulated(scenario, config))
    path, estimates, errors = localize(messages, config)
    scan = next(m for m in messages if isinstance(m, Scan) and m.time >= INSTANT_S)
    now = next(k for k, estimate in enumerate(estimates) if estimate.time == scan.time)
    if len(errors[now]) != arena.count - 1 or np.isnan(errors[now]).any():
        raise SystemExit("a teammate is missed or a post reported: the legend would be wrong")
    shown = scan.time - scenario.camera_delay_s  # of pictures that had arrived by then
    seen = [m for m in messages if isinstance(m, Bearings) and m.time <= shown][-1]
    poses = arena.poses(np.array([scan.time]))[0]
    own = poses[OBSERVER]
    places, posts = to_frame(poses[:, :2], own), to_frame(arena.posts, own)
    drawing = Drawing(to_frame(np.zeros(2), own))
    lines, points = rays(seen, path, scan.time), returns(scan, config, path)
    scenery(drawing, to_frame(arena.half_side_m * SQUARE, own), lines, config)
    for robot, pose in enumerate(np.column_stack((places, poses[:, 2] - own[2]))):
        drawing.robot(pose, OWN if robot == OBSERVER else TEAMMATE)
    drawing.dots(posts, SCALE * TURRET_RADIUS_M, TEAMMATE)
    drawing.dots(points, 1.2, SMALL)
    avoid = np.vstack((*np.linspace(lines[:, 0], lines[:, 1], 200), points, places))
    for mean, covariance in zip(estimates[now].positions, estimates[now].covariances, strict=True):
        drawing.estimate(mean, covariance)
        drawing.label(mean, f"{math.hypot(*mean):.2f} m", avoid, f'fill="{RED}"')
    for post in posts:
        drawing.label(post, "post", avoid, SMALL)
    legend(drawing)
    here_mm, mean_mm = 1e3 * errors[now].mean(), 1e3 * np.nanmean(np.concatenate(errors))
    drawing.text(520, 366, f"mean error: {here_mm:.0f} mm here, {mean_mm:.0f} mm over 60 s", SMALL)
    drawing.text(24, 506, f"tools/draw_scene.py: {SCENARIO}, {scan.time:.1f} s, filter phd", SMALL)
    return "\n".join([*drawing.parts, "</svg>"])


def scenery(drawing: Drawing, walls: FloatArray, lines: FloatArray, config: RobotConfig) -> None:
    """Walls (4, 2) m, and within them what is hidden and the cameras' rays."""
    drawing.parts.append('<clipPath id="arena">')
    drawing.shape(walls, "")
    drawing.parts.append('</clipPath><g clip-path="url(#arena)">')
    for pillar in config.lidar.blind_sectors:
        edges = pillar.centre_rad + pillar.width_rad * np.array([-0.5, 0.5])
        drawing.shape(np.vstack((np.zeros(2), FAR_M * unit(edges))), BLIND)
    for line in lines:
        drawing.shape(line, RAY, "polyline")
    drawing.parts.append("</g>")
    drawing.shape(walls, WALL)


def legend(drawing: Drawing) -> None:
    """What the marks mean, and the scale."""
    x, at = 536.0, drawing.at
    drawing.text(x - 16, 44, "Where are my teammates?", 'font-size="16" font-weight="bold"')
    drawing.text(x - 16, 64, "What one robot knows, its front up", SMALL)
    drawing.robot(np.array([*at(x, 100), -math.pi / 2]), OWN)
    drawing.robot(np.array([*at(x, 134), -math.pi / 2]), TEAMMATE)
    drawing.estimate(at(x, 168), np.diag([0.0016, 0.003]))
    for k in range(7):
        drawing.dots(at(x - 15 + 5 * k, 202 + k % 2), 1.2, SMALL)
    drawing.shape(np.stack((at(x - 16, 240), at(x + 16, 232))), RAY, "polyline")
    drawing.shape(np.stack((at(x - 18, 270), at(x + 18, 263), at(x + 18, 277))), BLIND)
    drawing.dots(at(x, 304), SCALE * TURRET_RADIUS_M, TEAMMATE)
    words = "this robot/teammate, as it truly is/estimate: mean, 2σ, distance/lidar returns of one "
    words += "turn/camera bearing, 5° noise/hidden by its own pillars/post: rightly not reported"
    for k, line in enumerate(words.split("/")):
        drawing.text(x + 32, 104.5 + 34 * k, line)
    drawing.text(x + 32, 325, "as thick as a teammate's turret", SMALL)
    bar = at(x - 16, 420) + 0.5 * np.array([[0.06, 0], [0, 0], [0, -1], [0.06, -1]])
    drawing.shape(bar, LINE, "polyline")
    drawing.text(x + 54, 424, "0.5 m", SMALL)


if __name__ == "__main__":
    print(picture(RobotConfig()))
