"""Filters, lidars, boards and scenarios by name: each is one entry, made by one `register` call.

robot.toml, the commands' options, replay, evaluate and the simulation know exactly the names that
are here. What swarmloc brings along is registered by the module that a registry names as its home;
anything else by a plugin: a file or module that calls `register` when it is imported
(docs/extending.md).
"""

import importlib
import importlib.util
import sys
from pathlib import Path
from typing import Any

from host.errors import UserError


class Registry:
    """Entries of one kind by name.

    kind: what an entry is called in messages; home: the module that registers the built-in ones,
    loaded when a name is first asked for; entry_type: the name there of an entry's class;
    next_step: of the error for an unknown name.
    """

    def __init__(self, kind: str, home: str, entry_type: str, next_step: str) -> None:
        self.kind = kind
        self._home = home
        self._entry_type = entry_type
        self._next_step = next_step
        self._entries: dict[str, Any] = {}

    def register(self, name: str, entry: object) -> None:
        """Add an entry. Raises TypeError for one of another type, ValueError for a taken name."""
        expected = getattr(importlib.import_module(self._home), self._entry_type)
        if not isinstance(entry, expected):
            raise TypeError(f"a {self.kind} is registered by a {self._entry_type}, not {entry!r}")
        if name in self._entries:
            raise ValueError(f"a {self.kind} is called {name!r} already: choose another name")
        self._entries[name] = entry

    def names(self) -> list[str]:
        """The names, in the order in which they were registered."""
        importlib.import_module(self._home)
        return list(self._entries)

    def get(self, name: str) -> Any:
        """The entry of this name. Raises UserError that lists the known ones."""
        known = self.names()
        if name not in known:
            raise UserError(
                f"no {self.kind} is called {name!r}", f"known: {', '.join(known)}", self._next_step
            )
        return self._entries[name]


_OWN = "one of your own needs --plugin: swarmloc --plugin FILE.py ..."

FILTERS = Registry(
    "filter",
    "host.estimator.profiles",
    "FilterEntry",
    f"choose one with --filter, or as profile in [filter] of robot.toml; {_OWN}",
)
LIDARS = Registry(
    "lidar",
    "host.simulation.devices.catalogue",
    "LidarEntry",
    f"choose one as model in [lidar] of robot.toml; {_OWN}",
)
BOARDS = Registry(
    "board",
    "host.simulation.devices.catalogue",
    "BoardEntry",
    f"choose one as model in [board] of robot.toml; {_OWN}",
)
BEHAVIOURS = Registry(
    "behaviour",
    "host.behaviour.catalogue",
    "BehaviourEntry",
    f"choose one, as in swarmloc drive walk; {_OWN}",
)
SCENARIOS = Registry(
    "scenario",
    "host.simulation.world.scenarios",
    "Scenario",
    f"choose one, with settings as in arena4:seconds=60,seed=1; {_OWN}",
)


def load_plugin(plugin: str) -> None:
    """Import a Python file (its path ends in .py) or an installed module, which registers entries.

    A second call for the same one does nothing. Raises UserError where it cannot be imported.
    """
    try:
        if plugin.endswith(".py"):
            _import_file(Path(plugin).resolve())
        else:
            importlib.import_module(plugin)
    except Exception as error:
        # A plugin is the user's own program: whatever it raises is the user's to read.
        raise UserError(
            f"cannot load the plugin {plugin}",
            f"{type(error).__name__}: {error}",
            "give the path of a .py file, or the name of an installed module",
        ) from error


def _import_file(path: Path) -> None:
    """Import a file under its own name, where its classes can be found again (copies, pickles)."""
    if not path.is_file():
        raise ImportError(f"there is no file {path}")
    name = path.stem
    loaded = sys.modules.get(name)
    if loaded is not None:
        if getattr(loaded, "__file__", None) == str(path):
            return
        raise ImportError(f"a module called {name!r} is loaded already: rename the file")
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
