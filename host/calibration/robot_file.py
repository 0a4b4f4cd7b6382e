"""Fitted values into robot.toml, where everything else stays as its owner wrote it.

The text is changed line by line, which keeps its layout and comments, and is then read back: it has
to say what is new and otherwise what it said before.
"""

import math
import os
import re
import shutil
import tempfile
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from decimal import ROUND_DOWN, ROUND_HALF_EVEN, Context, Decimal
from pathlib import Path
from typing import Any

import tomlkit

from host.calibration.result import SCREEN_UNITS
from host.config import RobotConfig, Section, load_config, parse_config
from host.errors import UserError, cannot_write

_DIGITS = 6  # significant: a micrometre of a wheel, a hundredth of a pixel
_HEADER = re.compile(r"\s*(\[\[?)([^\[\]]+)(\]\]?)\s*(?:#.*)?$")
_DATE = re.compile(r"\d{4}-\d{2}-\d{2}")
_FIGURE = re.compile(rf"(?<![\w.])(-?\d+(?:\.(\d+))?)(\s*)({'|'.join(SCREEN_UNITS)})(?!\w)")


def update(path: str | Path, settings: Mapping[str, Any], note: str) -> None:
    """Set dotted keys, as "lidar.heading_rad", in robot.toml and leave all other lines alone.

    A list of dicts is written as an array of tables. note: one line that says date, source and
    residuals; it becomes a comment under the header of each table that is written to, in place of
    an earlier one there that reads the same up to its date (YYYY-MM-DD). A comment that has a
    changed value in another unit gets the new one. The file changes as a whole or not at all.

    Raises UserError where the file cannot be read or written, or would not be a valid one.
    """
    path = Path(path)
    load_config(path)
    check_writable(path)
    text = path.read_bytes().decode("utf-8")  # read_text would lose how the lines end
    new = updated(text, settings, note, str(path))
    if new != text:
        _write(path.resolve(), new)


def check_writable(path: Path) -> None:
    """Raise UserError for a pipe, and for a file that its owner has set to read-only.

    A file is replaced as a whole, which its folder would allow.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise UserError(
            f"cannot write the configuration {path}",
            "it is a device or a pipe",
            "save it as a file, and name that with --robot",
        )
    if path.is_file() and not path.stat().st_mode & 0o222:
        raise UserError(
            f"cannot write the configuration {path}",
            "it is read-only",
            f"give a copy of it, or allow writing: chmod u+w {path}",
        )


def updated(text: str, settings: Mapping[str, Any], note: str, name: str = "robot.toml") -> str:
    """The text of a robot.toml with `settings` changed, as `update` does; `name` is its name."""
    windows = "\r\n" in text
    text = text.replace("\r\n", "\n")
    wanted = tomllib.loads(text)
    settings = {**_defaults_lost(wanted, settings), **settings}
    plain = {key: _plain(key, value) for key, value in settings.items()}
    note = "".join(c if c.isprintable() else " " for c in note.lstrip("# ")).strip()
    tables = _tables(text.rstrip("\n"))
    for section in dict.fromkeys(_section(key) for key in plain):
        here = {key.rpartition(".")[2]: v for key, v in plain.items() if _section(key) == section}
        _change(tables, section, here, note)
    new = "\n".join(line for table in tables for line in table.lines).rstrip("\n") + "\n"
    for key, value in plain.items():
        _set(wanted, key, value)
    read = _parsed([new])
    try:
        parse_config(new if read else text, name)
    except UserError as error:
        raise UserError(
            f"{name} stays as it was: what was found is no value it can hold",
            error.why,
            "check the settings of [mocap], and that the robot drove as docs/calibration.md says",
        ) from error
    if read != wanted:
        raise UserError(
            f"{name} stays as it was: its layout leaves no place for "
            + ", ".join(dict.fromkeys(_section(key) for key in plain)),
            "its tables are not written as in robots/cherokey.toml",
            "give each table its own header, as [camera.front]",
        )
    return new.replace("\n", "\r\n") if windows else new


def as_lines(settings: Mapping[str, Any]) -> str:
    """Dotted keys and values as lines of TOML, in the digits that `update` writes."""
    return "\n".join(f"{key} = {_toml(_plain(key, value))}" for key, value in settings.items())


def _defaults_lost(tree: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """What tables that are yet to come must say to leave their other settings as they are.

    The rear camera looks back, but a [camera.rear] that says nothing of it looks ahead.
    """
    lost: dict[str, Any] = {}
    for section in dict.fromkeys(_section(key) for key in settings):
        said: Any = tree
        table: Any = RobotConfig()
        for part in section.split("."):
            said, table = (said or {}).get(part), getattr(table, part, None)
        if isinstance(table, Section) and said is None:
            fresh, whole = type(table)().model_dump(), table.model_dump()
            lost.update({f"{section}.{k}": v for k, v in whole.items() if v != fresh[k]})
    return lost


def _plain(key: str, value: Any) -> Any:
    """A value as TOML has it, with as many digits as mean something."""
    if isinstance(value, list | tuple):
        return [
            {name: _plain(name, inner) for name, inner in item.items()}
            if isinstance(item, Mapping)
            else _plain(key, item)
            for item in value
        ]
    value = value.item() if hasattr(value, "item") else value  # a number of numpy's
    if not isinstance(value, float) or not math.isfinite(value):
        return value
    number = Decimal(f"{value:.12g}")
    # An angle of 90 or 180 deg is at its bound, and must not be rounded beyond it.
    rounding = ROUND_DOWN if key.endswith("_rad") else ROUND_HALF_EVEN
    return float(Context(prec=_DIGITS, rounding=rounding).plus(number))


def _set(tree: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = key.split(".")
    for table in tables:
        tree = tree.setdefault(table, {})
    tree[last] = value


def _section(key: str) -> str:
    return key.rpartition(".")[0]


def _toml(value: Any) -> str:
    """A value as TOML; a list of tables with one {...} a line."""
    if not (isinstance(value, list) and value and isinstance(value[0], Mapping)):
        return str(tomlkit.item(value).as_string())
    items = (", ".join(f"{k} = {_toml(v)}" for k, v in item.items()) for item in value)
    return "".join(("[\n", *(f"    {{{item}}},\n" for item in items), "]"))


@dataclass(slots=True, eq=False)
class _Table:
    """header: as "[lidar]" or "[[lidar.blind_sectors]]", "" of what stands above all tables.

    lines: those of the file, from the header to before the next one.
    """

    header: str
    lines: list[str]

    def change(self, key: str, value: Any) -> bool:
        """Set a key that is there already; whether it is."""
        for first, line in enumerate(self.lines):
            if re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line):
                ends = range(first + 1, len(self.lines) + 1)
                end = next((end for end in ends if _parsed(self.lines[first:end])), first + 1)
                if _parsed(self.lines[first:end]) != {key: value}:
                    self.lines[first:end] = _changed(self.lines[first:end], key, value)
                return True
        return False

    def split(self) -> tuple[list[str], list[str]]:
        """Its lines up to the last value, and what follows, which may belong to the next table."""
        values = (k for k, x in enumerate(self.lines) if x.strip() and x.lstrip()[0] != "#")
        last = max(values, default=-1) + 1
        return self.lines[:last], self.lines[last:]


def _tables(text: str) -> list[_Table]:
    """What `text` consists of: what is above all tables, then each of them."""
    tables = [_Table("", [])]
    for line in text.split("\n") if text else ():
        if match := _HEADER.match(line):
            name = ".".join(part.strip(" \"'") for part in match[2].split("."))
            tables.append(_Table(f"{match[1]}{name}{match[3]}", []))
        tables[-1].lines.append(line)
    return tables


def _parsed(lines: list[str]) -> dict[str, Any]:
    try:
        return tomllib.loads("\n".join(lines))
    except tomllib.TOMLDecodeError:
        return {}


def _changed(lines: list[str], key: str, value: Any) -> list[str]:
    """The lines of one key with another value; a comment stays in its column and is kept true."""
    *above, last = lines
    hashes = (k for k, c in enumerate(last) if c == "#" and _parsed([*above, last[:k]]))
    column = next(hashes, len(last))
    new = f"{lines[0].partition('=')[0]}= {_toml(value)}"
    if column < len(last):
        comment = _true_comment(last[column:], _parsed(lines)[key], value)
        new = f"{new:{max(column - 2, 0)}}  {comment}"
    return new.split("\n")


def _true_comment(comment: str, before: Any, value: Any) -> str:
    """A comment that has a changed number in another unit, too, with the new one."""

    def figure(match: re.Match[str]) -> str:
        shown, decimals, space, unit = match.groups()
        factor, places = SCREEN_UNITS[unit], len(decimals or "")
        if abs(float(shown) - before * factor) > 0.51 * 10.0**-places:
            return match[0]  # of something else
        return f"{value * factor:.{max(places, 1)}f}{space}{unit}"

    numbers = all(isinstance(each, int | float) for each in (before, value))
    return _FIGURE.sub(figure, comment) if numbers else comment


def _change(tables: list[_Table], section: str, values: Mapping[str, Any], note: str) -> None:
    """Set the values of one table, with the note below its header."""
    header = f"[{section}]" if section else ""
    table = next((table for table in tables if table.header == header), None)
    if table is None:
        table = _Table(header, [header])
        if any(each.lines for each in tables):
            tables[-1].lines.append("")
        tables.append(table)
    new = []
    if note and section:
        words = _DATE.split(note)[0]
        earlier = re.compile(rf"\s*#\s?{re.escape(words)}{_DATE.pattern}")
        table.lines = [line for line in table.lines if not earlier.match(line)]
        new.append(f"# {note}")
    for key, value in values.items():
        blocks = f"[[{section}.{key}]]" if section else f"[[{key}]]"
        if any(each.header == blocks for each in tables):
            _change_blocks(tables, blocks, value)
            if not value:
                new.append(f"{key} = []")
        elif not table.change(key, value):
            if isinstance(value, list) and value:
                _change_blocks(tables, blocks, value)
            else:
                new.append(f"{key} = {_toml(value)}")
    table.lines[bool(header) : bool(header)] = new


def _change_blocks(tables: list[_Table], header: str, values: list[dict[str, Any]]) -> None:
    """Change tables [[...]] one by one, so that their comments stay; add or drop at the end."""
    blocks = [table for table in tables if table.header == header]
    old = len(blocks)
    for block, value in zip(blocks, values, strict=False):
        block.lines[1:1] = [f"{k} = {_toml(v)}" for k, v in value.items() if not block.change(k, v)]
    for block in blocks[len(values) :]:
        before, (_, rest) = tables[tables.index(block) - 1], block.split()
        double = rest[:1] == [""] and before.lines[-1:] in ([], [""])
        before.lines += rest[double:]
        tables.remove(block)
    for value in values[old:]:
        last = blocks[-1] if blocks else tables[-1]
        kept, rest = last.split() if blocks else (last.lines, [])
        new = _Table(header, [header, *(f"{k} = {_toml(v)}" for k, v in value.items()), *rest])
        last.lines = [*kept, ""]
        tables.insert(tables.index(last) + 1, new)
        blocks.append(new)


def _write(path: Path, text: str) -> None:
    """Put `text` in the place of the file at once, with its permissions."""
    temporary = ""
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as file:
            file.write(text.encode("utf-8"))
            file.flush()
            os.fsync(file.fileno())
        shutil.copymode(path, temporary)
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            with suppress(OSError):
                os.unlink(temporary)
        next_step = "check that you may write to its folder and that the disk is not full"
        raise cannot_write(f"the configuration {path}", error, next_step) from error
