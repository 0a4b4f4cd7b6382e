"""`import swarmloc`: quick, complete, documented; and what the documentation shows runs."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmloc

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs/api.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
DATA = {"MRCLAM_Dataset6": "mrclam6", "optiodom": "optiodom"}  # as the page calls them


def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for registry in (swarmloc.FILTERS, swarmloc.SCENARIOS):  # other tests know their own names only
        monkeypatch.setattr(registry, "_entries", {n: registry.get(n) for n in registry.names()})
    names: dict[str, Any] = {"__name__": "api"}
    blocks = [block for block in BLOCKS if not any(name in block for name in DATA)]
    assert len(blocks) == len(BLOCKS) - len(DATA)
    for block in blocks:
        exec(compile(block, "docs/api.md", "exec"), names)
    assert names["estimate"].positions == pytest.approx(np.array([[1.57, 0.2]]), abs=0.02)
    assert names["row"].filter == "last_reading"
    assert names["error"].distance == pytest.approx(0.1)
    written = tomllib.loads(Path("robot.toml").read_text(encoding="utf-8"))["lidar"]["x_m"]
    assert written == pytest.approx(0.0, abs=0.005)


@pytest.mark.parametrize("name", DATA)
def test_the_examples_on_data_sets_run(name, recorded, tmp_path, monkeypatch, capsys) -> None:
    (tmp_path / name).symlink_to(recorded(DATA[name]))
    monkeypatch.chdir(tmp_path)
    (block,) = [block for block in BLOCKS if name in block]
    exec(compile(block, "docs/api.md", "exec"), {"swarmloc": swarmloc})
    assert capsys.readouterr().out


def test_every_public_name_is_there_and_documented() -> None:
    stub = ast.parse((ROOT / "swarmloc/__init__.pyi").read_text(encoding="utf-8"))
    exported = {
        ast.literal_eval(name)
        for node in ast.walk(stub)
        if isinstance(node, ast.List)
        for name in map(ast.unparse, node.elts)
    }
    assert exported == set(swarmloc.__all__) == set(dir(swarmloc))
    assert [name for name in swarmloc.__all__ if not hasattr(swarmloc, name)] == []
    shown = set(re.findall(r"[`.](\w+)", PAGE))
    assert exported - shown == set()


def test_a_name_that_is_not_public_is_refused() -> None:
    with pytest.raises(AttributeError, match="module 'swarmloc' has no attribute 'nothing'"):
        _ = swarmloc.nothing


def test_importing_loads_nothing_heavy() -> None:
    """Nor does a name load what another one needs: messages do without pictures and fits."""
    code = (
        "import sys, swarmloc; print('numpy' in sys.modules, 'host' in sys.modules);"
        "swarmloc.Positions; print(*(name in sys.modules for name in ('numpy', 'cv2', 'scipy')))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout == "False False\nTrue False False\n"
