"""Settings of the systems' own sources: what cannot be simulated or scored is refused, in words."""

import math

import pytest

from host.errors import UserError
from host.systems.catalogue import score_systems


@pytest.mark.parametrize(
    ("source", "system", "said"),
    [
        ("swarm:robots=1", "swarm_ukf", "from 2 to 60"),
        ("swarm:robots=-2", "swarm_ukf", "from 2 to 60"),
        ("swarm:seconds=1", "swarm_ukf", "from 3.0"),
        ("swarm:seconds=nan", "swarm_ukf", "from 3.0"),
        ("swarm:formation=blob", "swarm_ukf", "one of wander, circle, line"),
        ("swarm:range_sigma_m=0", "swarm_ukf", "from 0.001"),
        ("swarm:colour=red", "swarm_ukf", "known: formation, radius_m"),
        ("intruder:robots=2", "particles", "from 3 to 60"),
        ("intruder:seconds=0.5", "particles", "from 3.0"),
        ("intruder:sigma_m=0", "particles", "from 0.001"),
        ("overhead:robots=0", "id_phd", "from 1 to 60"),
        ("overhead:seconds=0.1", "id_phd", "from 1.0"),
        ("overhead:half_view_rad=0.05", "id_phd", "from 0.2"),
        ("overhead:robots=2,standing=2", "id_phd", "no robot drives"),
        ("overhead:robots=60", "id_phd", "61 robots and false things do not fit"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_with_what_can(
    source: str, system: str, said: str
) -> None:
    with pytest.raises(UserError) as refused:
        list(score_systems([source], [system]))
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("source", "system"),
    [
        ("swarm:robots=2,seconds=3", "swarm_ukf"),
        ("swarm:robots=2,seconds=3,radius_m=0.1", "swarm_ukf"),  # too near to see each other
        ("intruder:robots=3,seconds=3,outlier=0.9,speed_mps=0", "particles"),
        ("overhead:robots=1,seconds=1,false_things=0,detection=0.99", "id_phd"),
    ],
)
def test_the_least_that_is_allowed_is_scored(source: str, system: str) -> None:
    rows = list(score_systems([source], [system]))
    assert any("error_m" in row.figures for row in rows)
    for row in rows:
        errors = [value for name, value in row.figures.items() if name.startswith("error")]
        assert not any(map(math.isnan, errors)), row
