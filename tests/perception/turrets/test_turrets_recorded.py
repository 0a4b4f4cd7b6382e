"""Cones outdoors before a real X4, through the wire, the decoder and the search for candidates.

The labels are the cones' stated ranges, straight ahead; the cones are about 0.19 m wide at the
height of the beam, and only the lidar tells where they truly stood, so the bounds on the range are
those of a tape measure.
"""

from collections.abc import Callable
from pathlib import Path as File

import numpy as np
import pytest

from host.config import Lidar
from host.drivers.x4.protocol import ScanDecoder
from host.geometry import Path
from host.perception.turrets import turrets
from tests.x4_turns import NEXT_TURN, recorded_turns

LIDAR = Lidar(target_diameter_m=0.19, max_range_m=6.0)
STRAIGHT_AHEAD_RAD = np.radians(5.0)


# Least share of turns with the cone, most other candidates a turn. Three files show the same small
# thing 0.3 m behind the lidar in every turn; the fourth was taken among other objects.
@pytest.mark.parametrize(
    ("name", "least_found", "most_others"),
    [
        ("lidar_data_1m", 1.0, 0.1),
        ("lidar_data_3m", 0.97, 0.1),
        ("lidar_data_4.5m", 0.97, 0.1),
        ("lidar_data_noisy_2m_1", 0.98, 1.0),
    ],
)
def test_the_cone_is_found_where_it_was_put(
    recorded: Callable[[str], File], name: str, least_found: float, most_others: float
) -> None:
    folder = recorded("x4_cones")
    label_m = float((folder / f"{name}.txt").read_text().split()[1])
    cones, sigmas, others = [], [], []
    for turn in recorded_turns(folder / f"{name}.csv"):
        (scan,) = ScanDecoder().feed(turn.stream + NEXT_TURN, 0.0)
        found = turrets.find(scan, LIDAR, Path())
        ranges = np.hypot(*found.positions.T)
        bearings = np.arctan2(found.positions[:, 1], found.positions[:, 0])
        right = (np.abs(ranges - label_m) < 0.1) & (np.abs(bearings) < STRAIGHT_AHEAD_RAD)
        others.append(np.count_nonzero(~right))
        for k in np.flatnonzero(right):
            cones.append(found.positions[k])
            sigmas.append(np.sqrt(np.diagonal(found.covariances[k])))
        assert np.count_nonzero(right) <= 1
    assert len(others) > 80
    assert len(cones) >= least_found * len(others)
    assert np.mean(others) <= most_others
    # How restless a cone that stands still is, in std: 0.6 mm to 18 mm here. Across the beam it is
    # about twice what its covariance says, for the bearings of a real X4 wander by some 2.5 mrad
    # from revolution to revolution, which turrets cut into a scan do not show.
    spread = np.std(cones, axis=0) / np.mean(sigmas, axis=0)
    assert (spread > 0.3).all()
    assert (spread < 2.3).all()
