"""One entry for each name; what is unknown, taken or of the wrong kind is reported in words."""

import sys
from pathlib import Path

import pytest

from host.config import RobotConfig
from host.errors import UserError
from host.estimator import profiles
from host.estimator.last_reading import LastReading
from host.estimator.profiles import FilterEntry
from host.registry import BOARDS, FILTERS, LIDARS, SCENARIOS, Registry, load_plugin


@pytest.mark.parametrize(
    ("registry", "names"),
    [
        (FILTERS, {"pmb", "phd", "perera2021", "kalman_hungarian", "clairvoyant", "last_reading"}),
        (LIDARS, {"x4"}),
        (BOARDS, {"romeo"}),
        (SCENARIOS, {"arena4", "swarm20", "misbuilt4"}),
    ],
    ids=lambda value: value.kind if isinstance(value, Registry) else "",
)
def test_what_swarmloc_brings_along_is_registered(registry: Registry, names: set[str]) -> None:
    assert names <= set(registry.names())
    for name in registry.names():
        assert registry.get(name) is registry.get(name)
    with pytest.raises(UserError, match=f"no {registry.kind} is called 'magic'") as caught:
        registry.get("magic")
    assert all(name in caught.value.why for name in names)


def test_a_name_is_given_once_and_to_an_entry() -> None:
    with pytest.raises(ValueError, match="'phd' already"):
        FILTERS.register("phd", FilterEntry(lambda robot: LastReading()))
    with pytest.raises(TypeError, match="a filter is registered by a FilterEntry"):
        FILTERS.register("mine", LastReading)
    assert "mine" not in FILTERS.names()


def test_a_filter_that_needs_identities_is_for_evaluation_only() -> None:
    with pytest.raises(UserError, match="cannot run on a robot"):
        profiles.make("clairvoyant", RobotConfig())


def test_a_plugin_is_loaded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugin = tmp_path / "plugin_loaded_once.py"
    plugin.write_text(
        "from host.registry import SCENARIOS\n"
        "from host.simulation.world.scenarios import Scenario\n"
        "SCENARIOS.register('once', Scenario(name='once'))\n"
    )
    monkeypatch.setattr(SCENARIOS, "_entries", dict(SCENARIOS._entries))
    load_plugin(str(plugin))
    try:
        load_plugin(str(plugin))
        assert SCENARIOS.get("once").name == "once"
    finally:
        del sys.modules["plugin_loaded_once"]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("import nothing_of_this_name", "nothing_of_this_name"),
        ("def (", "SyntaxError"),
        ("raise SystemError('no such luck')", "no such luck"),
    ],
)
def test_a_plugin_that_cannot_be_loaded_is_told_and_leaves_nothing(
    tmp_path: Path, text: str, why: str
) -> None:
    plugin = tmp_path / "broken_plugin.py"
    plugin.write_text(text)
    with pytest.raises(UserError, match="cannot load the plugin") as caught:
        load_plugin(str(plugin))
    assert why in caught.value.why
    assert "broken_plugin" not in sys.modules


def test_a_plugin_that_is_not_there_or_hides_a_module_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"there is no file .*absent\.py"):
        load_plugin(str(tmp_path / "absent.py"))
    with pytest.raises(UserError, match="cannot load the plugin"):
        load_plugin("no_module_of_this_name")
    (tmp_path / "json.py").write_text("")
    with pytest.raises(UserError) as caught:
        load_plugin(str(tmp_path / "json.py"))
    assert "rename the file" in caught.value.why
