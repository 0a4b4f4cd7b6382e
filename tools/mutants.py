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
import importlib.abc
import importlib.util
import os
import random
import sys
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import cv2  # noqa: F401  (imported once, before the forks)
import hypothesis  # noqa: F401
import pydantic  # noqa: F401
import pytest
import scipy.spatial
import scipy.stats  # noqa: F401

import host.config  # noqa: F401  (of the project, what imports nothing of it)

ROOT = Path(__file__).resolve().parent.parent
MOST = 10  # mutants of one function: a random choice where it has more
LEAST_SHARE = 0.9  # of the mutants that no reason excuses
SEED = 7
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


_PAIRS = (
    "Add Sub, Mult Div, LShift RShift, BitAnd BitOr, Lt LtE, Gt GtE, Eq NotEq, Is IsNot, In NotIn"
)
_ONE_WAY = "FloorDiv Mult, Mod Mult, Pow Mult, BitXor BitOr, And Or, Or And"
_SWAPS: dict[type, type] = {}
for _pair in f"{_PAIRS}, {_ONE_WAY}".split(", "):
    _from, _to = (getattr(ast, name) for name in _pair.split())
    _SWAPS[_from] = _to
    if _pair in _PAIRS:
        _SWAPS[_to] = _from


def _changed(node: ast.AST) -> Iterator[ast.AST]:
    """The nodes that may stand in place of this one."""
    if isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp) and type(node.op) in _SWAPS:
        other = copy.deepcopy(node)
        other.op = _SWAPS[type(node.op)]()  # type: ignore[assignment]
        yield other
    if isinstance(node, ast.Compare):
        for k, operator in enumerate(node.ops):
            other = copy.deepcopy(node)
            other.ops[k] = _SWAPS[type(operator)]()  # type: ignore[call-overload]
            yield other
    if isinstance(node, ast.BoolOp):
        for k in range(len(node.values)):  # each condition dropped
            kept = [value for j, value in enumerate(node.values) if j != k]
            yield kept[0] if len(kept) == 1 else ast.BoolOp(node.op, kept)
    if isinstance(node, ast.UnaryOp):
        yield node.operand  # the sign, or the negation, dropped
    if isinstance(node, ast.If | ast.IfExp | ast.While):
        other = copy.deepcopy(node)
        other.test = ast.UnaryOp(ast.Not(), other.test)
        yield other
    if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        value = node.value
        if isinstance(value, bool):
            yield ast.Constant(not value)
        else:
            yield ast.Constant(value + 1 if isinstance(value, int) else 2.0 * value or 1.0)


def _sites(node: ast.AST) -> Iterator[tuple[ast.AST, str, int | None]]:
    """Every place in a function's body that can be changed, as parent, field and index there."""
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "args") and not isinstance(
            node, ast.Call
        ):
            continue
        for k, child in enumerate(value if isinstance(value, list) else [value]):
            # What an error says, and strings that are put together, are for reading.
            if isinstance(child, ast.AST) and not isinstance(child, ast.Raise | ast.JoinedStr):
                yield node, field, k if isinstance(value, list) else None
                yield from _sites(child)


def _function(tree: ast.Module, name: str) -> ast.FunctionDef:
    found: ast.AST = tree
    for part in name.split("."):
        (found,) = (n for n in ast.iter_child_nodes(found) if getattr(n, "name", "") == part)
    assert isinstance(found, ast.FunctionDef)
    return found


def mutants(tree: ast.Module, name: str) -> list[tuple[str, ast.Module]]:
    """The mutants of one function: what was changed, in words, and the module with the change."""
    found: list[tuple[str, ast.Module]] = []
    for parent, field, k in _sites(_function(tree, name)):
        value = getattr(parent, field)
        old: ast.AST = value if k is None else value[k]
        for new in _changed(old):
            if k is None:
                setattr(parent, field, new)
            else:
                value[k] = new
            line = getattr(old, "lineno", 0)
            before, after = (ast.unparse(n).split("\n")[0] for n in (old, new))
            context = ast.unparse(parent).split("\n")[0] if isinstance(old, ast.Constant) else ""
            words = f"{before} -> {after}" + (f"   in {context}" if context else "")
            found.append((f"{line}: {words}", copy.deepcopy(tree)))
            if k is None:
                setattr(parent, field, old)
            else:
                value[k] = old
    return found


class _Loader(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Loads one module from a syntax tree."""

    def __init__(self, module: str, path: Path, tree: ast.Module) -> None:
        self._module, self._path = module, str(path)
        self._code = compile(ast.fix_missing_locations(tree), self._path, "exec")

    def find_spec(self, name: str, path: object, target: object = None) -> object:  # type: ignore[override]
        if name != self._module:
            return None
        return importlib.util.spec_from_file_location(name, self._path, loader=self)  # type: ignore[arg-type]

    def exec_module(self, module: ModuleType) -> None:
        exec(self._code, module.__dict__)


def passes(target: Target, path: Path, tree: ast.Module, patience_s: float) -> bool:
    """Whether the tests pass with this module, in a process of their own."""
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        code = 2
        try:
            sys.meta_path.insert(0, _Loader(target.module, path, tree))
            sink = os.open(os.devnull, os.O_WRONLY)
            os.dup2(sink, 1)
            os.dup2(sink, 2)
            # What is imported already is not rewritten by pytest, which warns of it.
            options = [
                "-x",
                "-p",
                "no:cacheprovider",
                "-W",
                "ignore::pytest.PytestAssertRewriteWarning",
            ]
            code = int(pytest.main([*options, *target.tests]))
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
    tried = [m for m in mutants(tree, target.function) if _text(m[0]) not in target.equivalent]
    if len(tried) > MOST:
        tried = [tried[k] for k in sorted(random.Random(SEED).sample(range(len(tried)), MOST))]
    return len(tried), [words for words, t in tried if passes(target, path, t, patience_s)]


def _text(words: str) -> str:
    """What was changed, without the number of its line."""
    return words.partition(": ")[2]


def main() -> int:
    """Try the sample; 1 where too many survive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="functions whose module or name holds this")
    only = parser.parse_args().only
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
            print(f"    line {words}", flush=True)
    share = (total - left) / max(total, 1)
    print(f"{total - left} of {total} mutants killed, {share:.1%}; needed {LEAST_SHARE:.0%}")
    return int(share < LEAST_SHARE)


if __name__ == "__main__":
    sys.exit(main())
