"""docs/scenarios.md has every scenario and every setting, with its default and its bounds."""

import inspect
import re
from dataclasses import fields
from pathlib import Path

import pytest

from host.errors import UserError
from host.registry import SCENARIOS
from host.simulation.world import scenarios
from host.simulation.world.scenarios import Scenario, parse_scenario

TEXT = (Path(__file__).parents[3] / "docs" / "scenarios.md").read_text()


def test_every_setting_stands_in_the_table_with_its_default_and_bounds() -> None:
    rows = [line.split(" | ") for line in TEXT.splitlines() if line.startswith("| `")]
    cells = {row[0].strip("| `"): row[1:] for row in rows}
    for setting in fields(Scenario):
        if setting.name == "name":
            continue
        default, bounds, words = cells.pop(setting.name)
        assert str(setting.default).removesuffix(".0") == default, setting.name
        if "bounds" in setting.metadata:
            low, high = map(float, bounds.split(", "))
            assert (low, high) == setting.metadata["bounds"], setting.name
        assert len(words) > 5
    source = inspect.getsource(scenarios)
    # Not those of the registry: other tests register their own.
    assert set(cells) == set(re.findall(r'SCENARIOS\.register\(\s*"(\w+)"', source))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("arena4:standing=5", "standing=5 is more than robots=4"),
        ("arena4:intruders=4,stacks=all", "intruders=4 must be less than robots=4"),
        ("arena4:fence_m=4", "fence_m=4 is around the room of side_m=3"),
        ("arena4:behaviour=circle", "behaviour=circle needs stacks=own or stacks=all"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(text: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        parse_scenario(text)


def test_every_scenario_agrees_with_itself() -> None:
    for name in SCENARIOS.names():
        parse_scenario(name)
        parse_scenario(f"{name}:stacks=none")
