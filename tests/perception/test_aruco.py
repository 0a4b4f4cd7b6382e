"""Tags found in drawn pictures, against the poses they were drawn at."""

import math

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")
if not hasattr(cv2, "aruco"):
    pytest.skip("this OpenCV came without ArUco", allow_module_level=True)

from host.config import Ceiling, OverheadCamera  # noqa: E402
from host.perception.aruco import TagFinder  # noqa: E402
from tests.perception.drawn_tags import draw, draw_all, marker, pixel_of  # noqa: E402

DOWN = math.pi / 2
PLAIN = Ceiling()
# A wide lens, turned and off the middle of the floor.
WIDE = Ceiling(
    eye=OverheadCamera(
        z_m=2.5,
        tilt_rad=DOWN,
        focal_px=1200.0,
        k1=0.05,
        k2=-0.01,
        x_m=0.3,
        y_m=-0.2,
        heading_rad=1.0,
        centre_x_px=950.0,
        centre_y_px=548.0,
    )
)


def scene(ceiling: Ceiling, seed: int) -> dict[int, tuple[float, float, float]]:
    """Eight tags that do not touch, all in the picture."""
    random = np.random.default_rng(seed)
    tags: dict[int, tuple[float, float, float]] = {}
    while len(tags) < 8:
        x, y = random.uniform(-1.4, 1.4, 2)
        column, row = pixel_of(ceiling.eye, np.array([x, y, ceiling.tag_height_m]))
        if not (80 < column < 1840 and 80 < row < 1000):
            continue
        if any(math.hypot(x - other[0], y - other[1]) < 0.22 for other in tags.values()):
            continue
        tags[int(random.integers(50))] = (x, y, random.uniform(-math.pi, math.pi))
    return tags


@pytest.mark.parametrize("ceiling", [PLAIN, WIDE], ids=["plain", "wide"])
def test_tags_are_found_to_a_fraction_of_a_millimetre(ceiling: Ceiling) -> None:
    finder, off, turned = TagFinder(ceiling), [], []
    for seed in range(3):
        tags = scene(ceiling, seed)
        bodies = finder.find(draw(ceiling, tags, seed), 3.5)
        assert bodies.time == 3.5
        assert bodies.identities.tolist() == sorted(tags)
        truth = np.array([tags[number] for number in sorted(tags)])
        off += np.hypot(*(bodies.poses - truth)[:, :2].T).tolist()
        turned += np.abs(np.angle(np.exp(1j * (bodies.poses - truth)[:, 2]))).tolist()
    assert finder.counts == {"tags": 24, "misread": 0, "doubled": 0}
    assert np.median(off) < 2e-4
    assert np.quantile(off, 0.95) < 4e-4
    assert np.degrees(np.median(turned)) < 0.13


def test_heading_is_the_direction_of_the_printed_right() -> None:
    camera = PLAIN.eye  # looks down with the picture's up ahead: its right is -y
    picture = np.full((camera.height_px, camera.width_px), 255, np.uint8)
    picture[300:360, 900:960] = marker(7, 60)
    (pose,) = TagFinder(PLAIN.model_copy(update={"tag_m": 0.0945})).find(picture, 0.0).poses
    assert math.degrees(pose[2]) == pytest.approx(-90.0, abs=0.3)
    assert pose[0] > 0.3  # above the middle of the picture
    assert pose[1] > 0.0  # left of it


def test_a_number_seen_twice_is_nobody() -> None:
    finder = TagFinder(PLAIN)
    tags = [(4, (0.3, 0.2, 0.0)), (4, (-0.3, 0.2, 1.0)), (9, (0.0, -0.3, 2.0))]
    assert finder.find(draw_all(PLAIN, tags), 0.0).identities.tolist() == [9]
    assert finder.counts == {"tags": 1, "misread": 0, "doubled": 2}


def test_tags_of_another_size_are_not_taken_and_their_size_is_told() -> None:
    picture = draw(PLAIN, {4: (0.3, 0.2, 0.5), 9: (-0.3, 0.2, 1.0)})
    finder = TagFinder(PLAIN.model_copy(update={"tag_m": 0.12}))
    bodies = finder.find(picture, 0.0)
    assert bodies.identities.shape == (0,)
    assert bodies.poses.shape == (0, 3)
    assert finder.counts["misread"] == 2
    assert finder.side_m == pytest.approx(0.1, rel=0.02)


def test_a_wrong_height_moves_a_tag_away_from_the_camera_in_proportion() -> None:
    picture = draw(PLAIN, {4: (0.5, -1.0, 0.5)})
    low = TagFinder(PLAIN.model_copy(update={"tag_height_m": 0.29})).find(picture, 0.0)
    assert low.poses[0, :2] == pytest.approx(np.array([0.5, -1.0]) * 2.21 / 2.2, abs=4e-4)


def test_corners_whose_rays_never_meet_the_tags_are_nowhere() -> None:
    finder = TagFinder(Ceiling(eye=OverheadCamera(z_m=2.5, tilt_rad=0.0, focal_px=1400.0)))
    points = finder.on_floor(np.array([[959.5, 539.5], [959.5, 0.0], [959.5, 1000.0]]))
    assert np.isnan(points[:2]).all()
    assert points[2] == pytest.approx([2.2 / math.tan(460.5 / 1400.0), 0.0])
    below = TagFinder(PLAIN.model_copy(update={"tag_height_m": 2.6}))
    assert len(below.find(draw(PLAIN, {4: (0.0, 0.0, 0.0)}), 0.0).identities) == 0


@pytest.mark.parametrize("value", [0, 128, 255])
def test_an_empty_picture_shows_nobody(value: int) -> None:
    grey = np.full((1080, 1920), value, np.uint8)
    assert len(TagFinder(PLAIN).find(grey, 0.0).identities) == 0


def test_noise_shows_nobody() -> None:
    grey = np.random.default_rng(5).integers(0, 256, (1080, 1920), dtype=np.uint8)
    assert len(TagFinder(PLAIN).find(grey, 0.0).identities) == 0
