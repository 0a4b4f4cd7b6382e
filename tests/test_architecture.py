"""The layers of ARCHITECTURE.md: a file imports its own package and those of layers below."""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LAYERS = {
    "cli": 9,
    "experiments": 8,
    "sessions": 7,
    "doctor": 7,
    "sources": 6,
    "viewer": 6,
    "pipeline": 5,
    "systems": 5,
    "behaviour": 5,
    "simulation": 4,
    "localizer": 3,
    "cross_checks": 3,
    "calibration": 3,
    "evaluation": 3,
    "mapping": 3,
    "flashing": 3,
    "drivers": 2,
    "perception": 2,
    "estimator": 2,
    "recording": 2,
    "message_queue": 2,
    "messages": 1,
    "message_checks": 1,
    "geometry": 1,
    "config": 1,
    "registry": 1,
    "folders": 1,
    "errors": 1,
}
LOWEST = 1  # its files may import each other: errors ← config, messages ← geometry


def module_of(file: Path) -> str:
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(file): file for file in sorted((ROOT / "host").rglob("*.py"))}
PUBLIC = ROOT / "swarmloc"


def package(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def imports(module: str) -> dict[str, int]:
    """Modules of the repository that `module` imports anywhere in it, and on which line."""
    found = {}
    parent = module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = parent.split(".")[: len(parent.split(".")) - node.level + 1]
                base = ".".join([*above, *([base] if base else [])])
            submodules = [f"{base}.{alias.name}" for alias in node.names]
            names = [name if name in MODULES else base for name in submodules]
        else:
            continue
        for name in names:
            if name.split(".")[0] in ("host", "swarmloc", "tools", "tests"):
                found[name] = node.lineno
    return found


@pytest.mark.parametrize("module", sorted(set(MODULES) - {"host"}))
def test_a_file_imports_only_its_own_package_and_layers_below(module: str) -> None:
    assert package(module) in LAYERS, f"{module}: add its layer here and in ARCHITECTURE.md"
    layer = LAYERS[package(module)]
    for name, line in imports(module).items():
        where = f"{MODULES[module].relative_to(ROOT)}:{line} imports {name}"
        assert name in MODULES, f"{where}, which is no module of the package"
        if package(name) == package(module) or layer == LAYERS[package(name)] == LOWEST:
            continue
        assert LAYERS[package(name)] < layer, f"{where}, which is not in a layer below"


def test_every_package_has_a_layer() -> None:
    assert sorted(LAYERS) == sorted({package(module) for module in MODULES} - {""})


def test_the_public_package_is_names_of_host_and_nothing_more() -> None:
    files = sorted(path for path in PUBLIC.iterdir() if path.is_file())
    assert [path.name for path in files] == ["__init__.py", "__init__.pyi", "py.typed"]
    lists = ast.parse((PUBLIC / "__init__.pyi").read_text(encoding="utf-8")).body
    homes = [line.module for line in lists if isinstance(line, ast.ImportFrom)]
    assert set(homes) <= set(MODULES), "it imports host only"
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files) < 100


def test_the_plan_has_the_same_layers() -> None:
    plan = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    layer, stated = 0, {}
    for number, row in re.findall(r"^\| (\d?) ?\| (`host/.*)", plan, re.MULTILINE):
        layer = int(number or layer)
        stated |= dict.fromkeys(re.findall(r"`(?:host/)?(\w+)(?:/|\.py)`", row), layer)
    assert {name: stated.get(name) for name in LAYERS} == LAYERS


def test_the_plan_names_files_that_there_are() -> None:
    plan = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(re.findall(r"\b(?:host|firmware|tests|tools|docs)/[\w/.]*\w", plan))
    assert len(named) > 20
    assert [path for path in sorted(named) if not (ROOT / path).exists()] == ["host/data"]


def test_tools_do_not_lean_on_the_command_line() -> None:
    for file in sorted((ROOT / "tools").rglob("*.py")):
        assert "host.cli" not in file.read_text(encoding="utf-8"), file


def test_no_file_imports_itself_by_a_detour() -> None:
    graph = {module: list(imports(module)) for module in MODULES}
    TopologicalSorter(graph).prepare()  # raises CycleError with the cycle


def test_the_package_itself_is_empty_so_that_importing_one_part_loads_no_other() -> None:
    assert not imports("host")
