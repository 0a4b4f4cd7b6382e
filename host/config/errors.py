"""What is wrong in a robot.toml, in words: the key, its line, the bound, and a guess."""

import difflib
import math
import re
import tomllib
import typing
from collections.abc import Iterator

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

# Units of the screen that are written for those of a key, and what one of them is in it.
_UNITS = {"_rad": ("deg", math.pi / 180.0), "_m": ("mm", 1e-3), "_s": ("ms", 1e-3)}
NOT_REGISTERED = "not_registered"  # the type of a validation error: a name without an entry


def explain_settings(
    error: ValidationError, model: type[BaseModel], text: str | None = None
) -> list[str]:
    """One line for each setting that cannot be used; with its line where the `text` is known."""
    return [_explain(detail, model, text) for detail in error.errors()]


def _explain(detail: ErrorDetails, model: type[BaseModel], text: str | None) -> str:
    location = list(detail["loc"])
    key = ".".join(str(part) for part in location)
    where = key if text is None else f"line {_line_of(location, text)}: {key}"
    match detail["type"]:
        case "extra_forbidden":
            return f"{where}: no such setting{_suggestion(location, model)}"
        case "missing":
            return f"{where} is missing"
        case "model_type":
            return f"{where} must be a table: write [{key}] above its settings"
        case "value_error":
            words = str(detail["ctx"]["error"])
            if text is not None:  # words about two settings begin with the name of one
                named = [_line_of([*location, name], text) for name in re.findall(r"\w+", words)]
                where = f"line {max(named, default=_line_of(location, text))}: {key}"
            return f"{where}: {words}"
    message = detail["msg"]
    hint = _unit_hint(key, detail["input"])
    return f"{where} = {detail['input']!r}: {message[:1].lower()}{message[1:]}{hint}"


def _unit_hint(key: str, value: object) -> str:
    """What the user may have meant by a number out of bounds: one in the unit of the screen."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return ""
    for suffix, (unit, factor) in _UNITS.items():
        if key.endswith(suffix):
            return f"; {value:g} {unit} are {value * factor:.6g} {suffix[1:]}"
    return ""


def explain_toml(error: tomllib.TOMLDecodeError, text: str) -> str:
    """What keeps a text from being TOML, by its line, with a guess."""
    if text.startswith("\ufeff"):
        return "line 1 begins with a byte-order mark: save it as UTF-8 without one (BOM)"
    seen: dict[tuple[str, ...], int] = {}
    for number, path in _paths(text, None):
        header = text.splitlines()[number - 1].lstrip().startswith("[[")
        first = seen.setdefault(tuple(path), number)
        if first != number and not header and "[[" not in text[: _offset(text, number)]:
            return f"line {number}: {'.'.join(path)} is set twice, first in line {first}"
    found = re.search(r"line (\d+)", str(error))
    line = text.splitlines()[int(found[1]) - 1] if found else ""
    if re.search(r"=\s*-?\d+,\d", line):
        return f"{error}: write decimals with a point, as 0.5"
    if re.search(r"=\s*[A-Za-z/]", line):
        return f'{error}: write text in quotes, as name = "five"'
    return str(error)


def _offset(text: str, line: int) -> int:
    """Where a line (from 1) of the text ends."""
    return sum(len(each) for each in text.splitlines(keepends=True)[:line])


def _suggestion(location: list[int | str], model: type[BaseModel]) -> str:
    """What the user may have meant: the same quantity in another unit, or a near spelling."""
    for part in location[:-1]:
        if isinstance(part, str):
            model = next(_sections(model.model_fields[part].annotation))
    unknown, known = str(location[-1]), list(model.model_fields)
    stem = unknown.rpartition("_")[0]
    same = [name for name in known if stem and name.rpartition("_")[0] == stem]
    if same:
        return f"; the unit is wrong: write {same[0]}"
    near = difflib.get_close_matches(unknown, known, 1)
    return f"; did you mean {near[0]}?" if near else f"; known here: {', '.join(known)}"


def _sections(annotation: object) -> Iterator[type[BaseModel]]:
    """The model that an annotation names, itself or as the items of a tuple."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in typing.get_args(annotation):
        yield from _sections(part)


def _line_of(location: list[int | str], text: str) -> int:
    """The line (from 1) of the key at `location`; that of its table where the key is missing.

    The TOML reader of the standard library keeps no positions, so the headers are followed here.
    """
    names = [str(part) for part in location if isinstance(part, str)]
    item = next((part for part in location if isinstance(part, int)), None)
    best = (0, 1)
    for number, path in _paths(text, item):
        common = min(len(path), len(names))  # a header may go deeper than the unknown table
        if path[:common] == names[:common] and common > best[0]:
            best = (common, number)
    return best[1]


def _paths(text: str, item: int | None) -> Iterator[tuple[int, list[str]]]:
    """Line and full path of each header and key; of repeated tables, only of `item` (from 0)."""
    table: list[str] = []
    items: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        header = re.match(r"\s*(\[\[?)([^\]]+)\]", line)
        key = re.match(r"\s*([\w\"'.-]+)\s*=", line)
        if header:
            table = [part.strip(" \"'") for part in header[2].split(".")]
            if header[1] == "[[":
                items[header[2]] = items.get(header[2], -1) + 1
                if item not in (None, items[header[2]]):
                    table = ["(another item)"]
            yield number, table
        elif key:
            yield number, table + [part.strip("\"'") for part in key[1].split(".")]
