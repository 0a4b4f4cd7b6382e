"""swarmloc from Python: its public names, documented with examples in docs/api.md.

A name is loaded when it is first used, so that importing swarmloc takes no time. The one list of
names, with their types, is __init__.pyi beside this file.
"""

import ast
import importlib
from pathlib import Path
from typing import Any

_LIST = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_HOMES = {
    alias.asname or alias.name: (str(line.module), alias.name)
    for line in _LIST.body
    if isinstance(line, ast.ImportFrom)
    for alias in line.names
}
__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, original = _HOMES[name]
    value = globals()[name] = getattr(importlib.import_module(module), original)
    return value


def __dir__() -> list[str]:
    return __all__
