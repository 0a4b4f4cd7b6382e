"""Mutation test of a sample of functions: each small change to one must make one of its tests fail.

    .venv/bin/python tools/mutants.py                   # prints survivors and the share killed
    .venv/bin/python tools/mutants.py --only geometry   # functions whose name holds a text

mutmut and cosmic-ray mutate whole modules and start a new Python for every mutant, most of which
goes into importing numpy, scipy and OpenCV. Here a mutant is a forked process in which those
stand imported already; it loads the changed module in place of the file, which is never touched.
"""

import argparse
import ast
import contextlib
import copy
import importlib.util
import os
import random
import sys
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2  # noqa: F401  (imported once, before the forks)
import hypothesis
import pytest
import scipy.spatial
import scipy.stats  # noqa: F401

import host.config  # noqa: F401  (of the project, what imports nothing of it)

ROOT = Path(__file__).resolve().parent.parent
MOST = 10  # mutants of one function: a random choice where it has more
LEAST_SHARE = 0.9  # of the mutants that no reason excuses
SEED = 7
# What is imported already is not rewritten by pytest, which warns of it.
_OPTIONS = ["-x", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning"]
_SLOWER = 6.0  # than the unchanged code: taken for an endless loop


@dataclass(frozen=True, slots=True)
class Target:
    """One function, the test files that guard it, and mutants that are no fault, with reasons."""

    module: str
    function: str
    tests: list[str]
    equivalent: dict[str, str]


def sample() -> list[Target]:
    """The functions listed in mutants.toml."""
    tables = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())["function"]
    found = []
    for table in tables:
        module, _, function = table["where"].partition(":")
        found.append(Target(module, function, table["tests"], table.get("equivalent", {})))
    return found


_PAIRS = "Add Sub, Mult Div, LShift RShift, BitAnd BitOr, And Or"
_PAIRS += ", Lt LtE, Gt GtE, Eq NotEq, Is IsNot, In NotIn"
_ONE_WAY = "FloorDiv Mult, Mod Mult, Pow Mult, BitXor BitOr"
_SWAPS: dict[type, type] = {}
for _pair in f"{_PAIRS}, {_ONE_WAY}".split(", "):
    _from, _to = (getattr(ast, name) for name in _pair.split())
    _SWAPS[_from] = _to
    if _pair in _PAIRS:
        _SWAPS[_to] = _from


def _changed(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes that may stand in place of this one."""
    if isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp) and type(node.op) in _SWAPS:
        yield _with(node, op=_SWAPS[type(node.op)]())
    if isinstance(node, ast.Compare):
        for k, operator in enumerate(node.ops):
            swapped = [*node.ops[:k], _SWAPS[type(operator)](), *node.ops[k + 1 :]]
            yield _with(node, ops=swapped)
    if isinstance(node, ast.BoolOp):
        for k in range(len(node.values)):  # each condition dropped
            kept = node.values[:k] + node.values[k + 1 :]
            yield kept[0] if len(kept) == 1 else ast.BoolOp(node.op, kept)
    if isinstance(node, ast.UnaryOp):
        yield node.operand  # the sign, or the negation, dropped
    if isinstance(node, ast.If | ast.IfExp | ast.While):
        yield _with(node, test=ast.UnaryOp(ast.Not(), node.test))
    if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        value = node.value
        changed = value + 1 if isinstance(value, int) else 2.0 * value or 1.0
        yield ast.Constant(not value if isinstance(value, bool) else changed)


def _with(node: ast.AST, **fields: object) -> ast.AST:
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def _nodes(parent: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Every node of a function's body that may be changed, with its parent."""
    skipped = () if isinstance(parent, ast.Call) else ("annotation", "returns", "args")
    for field, value in ast.iter_fields(parent):
        for node in value if isinstance(value, list) else [value]:
            # What an error says, and strings that are put together, are for reading.
            read = field in skipped or isinstance(node, ast.Raise | ast.JoinedStr)
            if isinstance(node, ast.AST) and not read:
                yield node, parent
                yield from _nodes(node)


def _function(tree: ast.Module, name: str) -> ast.FunctionDef:
    found: ast.AST = tree
    for part in name.split("."):
        (found,) = (n for n in ast.iter_child_nodes(found) if getattr(n, "name", "") == part)
    assert isinstance(found, ast.FunctionDef)
    return found


def mutants(tree: ast.Module, name: str) -> list[tuple[str, ast.Module]]:
    """The mutants of one function: what was changed, as text, and the module with the change."""
    function, found = _function(tree, name), []
    for old, parent in list(_nodes(function)):
        whole = f"   in {_line(parent)}" if isinstance(old, ast.Constant) else ""
        for new in _changed(old):
            words = f"{_line(old)} -> {_line(new)}{whole}"
            _Exchange(old, new).visit(function)
            found.append((words, copy.deepcopy(tree)))
            _Exchange(new, old).visit(function)
    return found


def _line(node: ast.AST) -> str:
    return ast.unparse(node).split("\n")[0]


class _Exchange(ast.NodeTransformer):
    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self._new if node is self._old else super().visit(node)  # type: ignore[no-any-return]


def _load(target: Target, path: Path, tree: ast.Module) -> None:
    """Put the module made from a syntax tree where imports find it."""
    spec = importlib.util.spec_from_file_location(target.module, path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[target.module] = module
    exec(compile(ast.fix_missing_locations(tree), str(path), "exec"), module.__dict__)


def passes(target: Target, path: Path, tree: ast.Module, patience_s: float) -> bool:
    """Whether the tests pass with this module, in a process of their own."""
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        code = 2
        try:
            sink = os.open(os.devnull, os.O_WRONLY)
            os.dup2(sink, 1)
            os.dup2(sink, 2)
            _load(target, path, tree)
            code = int(pytest.main([*_OPTIONS, *target.tests]))
        finally:
            os._exit(code)
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.01)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, 9)
    os.waitpid(child, 0)
    return False


def survivors(target: Target) -> tuple[int, list[str]]:
    """How many mutants were tried, and what was changed in those that no test noticed."""
    path = ROOT / (target.module.replace(".", "/") + ".py")
    tree = ast.parse(path.read_text())
    start = time.monotonic()
    if not passes(target, path, tree, 600.0):
        sys.exit(f"{target.function}: its tests fail, or cannot run, with the code as it is")
    patience_s = 10.0 + _SLOWER * (time.monotonic() - start)
    tried = [m for m in mutants(tree, target.function) if m[0] not in target.equivalent]
    if len(tried) > MOST:
        tried = [tried[k] for k in sorted(random.Random(SEED).sample(range(len(tried)), MOST))]
    return len(tried), [words for words, t in tried if passes(target, path, t, patience_s)]


def main() -> int:
    """Try the sample; 1 where too many survive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="functions whose module or name holds this")
    only = parser.parse_args().only
    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)  # one failure is enough
    hypothesis.settings.register_profile("mutants", phases=phases)
    hypothesis.settings.load_profile("mutants")
    os.chdir(ROOT)
    sys.path.insert(0, str(ROOT))
    total = left = 0
    for target in sample():
        name = f"{target.module}:{target.function}"
        if only not in name:
            continue
        tried, alive = survivors(target)
        total, left = total + tried, left + len(alive)
        print(f"{name}: {tried - len(alive)} of {tried} killed", flush=True)
        for words in alive:
            print(f"    survived: {words}", flush=True)
    share = (total - left) / max(total, 1)
    print(f"{total - left} of {total} mutants killed, {share:.1%}; needed {LEAST_SHARE:.0%}")
    return int(share < LEAST_SHARE)


if __name__ == "__main__":
    sys.exit(main())
