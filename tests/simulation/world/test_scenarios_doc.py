"""docs/scenarios.md has every scenario and every setting, with its default and its bounds."""

import inspect
import re
from dataclasses import fields
from pathlib import Path

from host.simulation.world import scenarios
from host.simulation.world.scenarios import Scenario

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
