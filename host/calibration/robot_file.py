"""Fitted values into robot.toml, where everything else stays as its owner wrote it."""

import functools
import math
import os
import re
import shutil
import tempfile
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from decimal import ROUND_DOWN, ROUND_HALF_EVEN, Context, Decimal
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array

from host.calibration.robot_file_comments import update_comment
from host.config import RobotConfig, Section, load_config, parse_config
from host.errors import UserError

_DIGITS = 6  # significant: a micrometre of a wheel, a hundredth of a pixel
_HEADER = re.compile(r"\s*\[([^\[\]]+)\]\s*(?:#.*)?$")
_WHOLE: Any = RobotConfig()
_DATE = re.compile(r"\d{4}-\d{2}-\d{2}")


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
    # Not by read_text, which would lose how the lines end.
    text = path.read_bytes().decode("utf-8")
    new = updated(text, settings, note, str(path))
    if new != text:
        _write(path.resolve(), new)


def check_writable(path: Path) -> None:
    """Raise UserError for a file that its owner has set to read-only.

    It is replaced as a whole, which its folder would allow.
    """
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
    old = tomllib.loads(text)
    settings = {**_defaults_lost(old, settings), **settings}
    defaults = _WHOLE.model_dump()
    plain = {key: _plain(key, value, _get(defaults, key)) for key, value in settings.items()}
    missing: dict[str, dict[str, Any]] = {}
    try:
        new = _annotate(_replace(text, plain, missing), plain, missing, note)
        read = tomllib.loads(new)
    except (TOMLKitError, tomllib.TOMLDecodeError) as error:
        raise _no_place(name, plain) from error
    for key, value in plain.items():
        _set(old, key, value)
    try:
        parse_config(new, name)
    except UserError as error:
        raise UserError(
            f"{name} stays as it was: what was found is no value it can hold",
            error.why,
            "check the settings of [mocap], and that the robot drove as docs/calibration.md says",
        ) from error
    if read != old:
        raise _no_place(name, plain)
    return new.replace("\n", "\r\n") if windows else new


def _defaults_lost(tree: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """What tables that are yet to come must say to leave their other settings as they are.

    The rear camera looks back, but a [camera.rear] that says nothing of it looks ahead.
    """
    lost = {}
    for section in dict.fromkeys(_section(key) for key in settings):
        table = functools.reduce(lambda t, part: getattr(t, part, None), section.split("."), _WHOLE)
        if isinstance(table, Section) and _get(tree, section) is None:
            fresh = type(table)().model_dump()
            lost.update(
                {f"{section}.{k}": v for k, v in table.model_dump().items() if v != fresh[k]}
            )
    return lost


def _no_place(name: str, settings: Mapping[str, Any]) -> UserError:
    return UserError(
        f"{name} stays as it was: its layout leaves no place for "
        + ", ".join(dict.fromkeys(_section(key) for key in settings)),
        "its tables are not written as in robots/cherokey.toml",
        "give each table a header of its own, as [camera.front]",
    )


def _plain(key: str, value: Any, default: Any) -> Any:
    """A value as TOML has it, with as many digits as mean something."""
    if isinstance(value, list | tuple):
        return [
            {name: _plain(name, inner, None) for name, inner in item.items()}
            if isinstance(item, Mapping)
            else _plain(key, item, None)
            for item in value
        ]
    value = value.item() if hasattr(value, "item") else value  # a number of numpy's
    if not isinstance(value, float) or not math.isfinite(value):
        return value
    if isinstance(default, int) and value.is_integer():
        return int(value)
    number = Decimal(f"{value:.12g}")
    # An angle of 90 or 180 deg is at its bound, and must not be rounded beyond it.
    rounding = ROUND_DOWN if key.endswith("_rad") else ROUND_HALF_EVEN
    return float(Context(prec=_DIGITS, rounding=rounding).plus(number))


def _get(tree: Mapping[str, Any], key: str) -> Any:
    found: Any = tree
    for part in key.split("."):
        found = found.get(part) if isinstance(found, Mapping) else None
    return found


def _set(tree: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = key.split(".")
    for table in tables:
        tree = tree.setdefault(table, {})
    tree[last] = value


def _section(key: str) -> str:
    return key.rpartition(".")[0]


def _replace(text: str, settings: Mapping[str, Any], missing: dict[str, dict[str, Any]]) -> str:
    """The text with the values changed of those keys that it has; the others go to `missing`."""
    document = tomlkit.parse(text)
    headers = {_header(line) for line in text.split("\n")}
    for key, value in settings.items():
        section, _, last = key.rpartition(".")
        table: Any = document
        for part in section.split(".") if section else ():
            table = table.get(part) if hasattr(table, "get") else None
        known = table is not None and last in table
        if known and (not section or section in headers or isinstance(table[last], AoT)):
            _change(table, last, value)
        else:
            missing.setdefault(section, {})[last] = value
    return tomlkit.dumps(document)


def _change(table: Any, key: str, value: Any) -> None:
    before = table[key]
    if isinstance(before, AoT):
        if value:
            _change_items(before, value)
        else:
            table[key] = tomlkit.array()
            table[key].trivia.trail = "\n\n"
    elif before != value:
        table[key] = in_lines(value) if isinstance(before, Array) else value
        update_comment(table[key], before, value)


def in_lines(value: list[dict[str, Any]]) -> Array:
    """A list of dicts as an array [...] of tables {...}, one a line."""
    array = tomlkit.array()
    for item in value:
        entry = tomlkit.inline_table()
        entry.update(item)
        array.append(entry)
    return array.multiline(bool(value))


def _change_items(items: AoT, values: list[dict[str, Any]]) -> None:
    """Change tables [[...]] one by one, so that their comments stay; add or drop at the end."""
    for item, value in zip(items, values, strict=False):
        for key in [key for key in item if key not in value]:
            del item[key]
        for key, inner in value.items():
            if key in item:
                _change(item, key, inner)
            else:
                item[key] = inner
    for _ in range(len(items) - len(values)):
        del items[-1]
    for value in values[len(items) :]:
        table = tomlkit.table()
        table.update(value)
        table.add(tomlkit.nl())
        items.append(table)


def _annotate(
    text: str, settings: Mapping[str, Any], missing: Mapping[str, dict[str, Any]], note: str
) -> str:
    """The text with the note, and with what is `missing`, under the headers of its tables."""
    note = "".join(c if c.isprintable() else " " for c in note.lstrip("# ")).strip()
    # What stands above all tables, as the robot's name, has no header for a note.
    sections = [s for s in dict.fromkeys(_section(key) for key in settings) if s or s in missing]
    lines = _without_note(text.split("\n"), sections, note)
    for section in sections:
        beneath = [f"# {note}"] if note else []
        after: list[str] = []
        for key, value in missing.get(section, {}).items():
            (after if _is_tables(value) else beneath).append(_written(section, key, value))
        header = next((k for k, line in enumerate(lines) if _header(line) == section), None)
        if header is None:
            lines = [*_ended(lines), f"[{section}]", *beneath, ""]
        else:
            lines[header + 1 : header + 1] = beneath
        if after:
            lines = [*_ended(lines), *"\n".join(after).split("\n")]
    return "\n".join(lines)


def _ended(lines: list[str]) -> list[str]:
    """The lines with exactly one that is blank after the last."""
    last = max((k for k, line in enumerate(lines) if line.strip()), default=-1)
    return [*lines[: last + 1], ""] if last >= 0 else []


def _without_note(lines: list[str], sections: list[str], note: str) -> list[str]:
    """The lines without the notes, under the headers of `sections`, that `note` replaces."""
    words = _DATE.split(note)[0]
    kept, here = [], ""
    for line in lines:
        header = _header(line)
        here = here if header is None else header
        comment = line.strip().removeprefix("# ")
        is_note = line.strip().startswith("#") and comment.startswith(words)
        if here in sections and is_note and note and _DATE.match(comment[len(words) :]):
            continue
        kept.append(line)
    return kept


def _header(line: str) -> str | None:
    """The name of the table that a line [name] begins, "[]" for [[name]]; None for other lines."""
    if line.lstrip().startswith("[["):
        return "[]"
    match = _HEADER.match(line)
    return ".".join(part.strip(" \"'") for part in match[1].split(".")) if match else None


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _written(section: str, key: str, value: Any) -> str:
    if not _is_tables(value):
        return f"{key} = {tomlkit.item(value).as_string()}"
    name = f"{section}.{key}" if section else key
    items = ("".join(f"{k} = {tomlkit.item(v).as_string()}\n" for k, v in i.items()) for i in value)
    return "\n".join(f"[[{name}]]\n{item}" for item in items)


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
        raise UserError(
            f"cannot write the configuration {path}",
            error.strerror or str(error),
            "check that you may write to its folder and that the disk is not full",
        ) from error
