"""What is wrong in a robot.toml, as text: the key, its line, the bound, and a guess."""

import difflib
import itertools
import math
import re
import typing
from collections.abc import Iterator

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

# Units of the screen that are written for those of a key, and what one of them is in it.
_UNITS = {"_rad": ("deg", math.pi / 180.0), "_m": ("mm", 1e-3), "_s": ("ms", 1e-3)}
NOT_REGISTERED = "not_registered"  # the type of a validation error: a name without an entry
_SHOWN_SETTINGS, _SHOWN_LETTERS = 5, 60
_KINDS = {
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "tuple_type": "a list of tables: write [[{key}]] above each",
}
_OPEN_QUOTE = r"=\s*(\"[^\"]*|'[^']*)$"
# What a line that is not TOML looks like, and what to write instead.
_SYNTAX = (
    (r"[“”„‘’«»]", 'write straight quotes, as name = "five"'),
    (r"^\s*[{}]", "write key = value, one a line, and [table] above those of a table"),
    (r"^\s*[\w.-]+\s*:", "write = between a key and its value"),
    (r"^\s*\w+ +\w+\s*=", "write a key without spaces, as track_m"),
    (r"^\s*\[[^\]]*$", "a ] is missing"),
    (_OPEN_QUOTE, "the quote at the end is missing"),
    (r"=\s*[-+]?\d+,\d", "write decimals with a point, as 0.5"),
    (r"=\s*[-+]?(\.\d|\d+\.(\D|$))", "write digits before and after the point, as 0.5"),
    (r"=\s*[-+]?0\d", "write the number without the 0 in front"),
    (r"=\s*([-+]?[\d.]+|[-+]?pi)\s*[*/+-]", "write the result: nothing is calculated here"),
    (r"=\s*[-+]?[\d.]+\s*[A-Za-z°µ]", "write the number alone: its unit is that of the key"),
    (r"=\s*(?i:true|false|yes|no|on|off)\b", "write true or false, in small letters"),
    (r"=\s*[A-Za-z/.]", 'write text in quotes, as name = "five"'),
)


def explain_settings(
    error: ValidationError, model: type[BaseModel], text: str | None = None
) -> str:
    """A line for each of the first settings that cannot be used; its number if `text` is known."""
    found = [_explain(detail, model, text) for detail in error.errors()]
    left = len(found) - _SHOWN_SETTINGS
    more = [f"and {left} more"] if left > 0 else []
    return "\n".join([*found[:_SHOWN_SETTINGS], *more])


def _explain(detail: ErrorDetails, model: type[BaseModel], text: str | None) -> str:
    location = list(detail["loc"])
    key = _shown(".".join(str(part) or '""' for part in location))
    where = key if text is None else f"line {_line_of(location, text)}: {key}"
    match detail["type"]:
        case "extra_forbidden":
            return f"{where}: no such setting{_suggestion(location, model)}"
        case "missing":
            return f"{where} is missing"
        case "model_type":
            table = f"[[{'.'.join(map(str, location[:-1]))}]]" if _is_item(location) else f"[{key}]"
            return f"{where} must be a table: write {table} above its settings"
        case "value_error":
            words = str(detail["ctx"]["error"])
            if text is not None:  # words about two settings begin with the names of both
                names = [found.split(".") for found in re.findall(r"\w[\w.]*", words)]
                lines = [_line_of([*location, *name], text) for name in names]
                where = f"line {max(lines, default=_line_of(location, text))}: {key}"
            return f"{where}: {words}" if key else f"{where}{words}"
    value = detail["input"]
    kind = _KINDS.get(detail["type"], "").format(key=key)
    words = f"must be {kind}" if kind else re.sub("^(Input|String) should", "must", detail["msg"])
    if "number" in kind and isinstance(value, str | float):
        words += ", without quotes and unit" if isinstance(value, str) else ", without a point"
    words += _unit_hint(location, value, model)
    return f"{where} = {_shown(repr(value))}: {words[:1].lower()}{words[1:]}"


def _is_item(location: list[int | str]) -> bool:
    return isinstance(location[-1], int)


def _shown(text: str) -> str:
    """Text from the file, without what would write over the screen or fill it."""
    clean = "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)
    return clean if len(clean) <= _SHOWN_LETTERS else f"{clean[:_SHOWN_LETTERS]}…"


def _unit_hint(location: list[int | str], value: object, model: type[BaseModel]) -> str:
    """What the user may have meant by a number out of bounds: one in the unit of the screen.

    Only where that is within the bounds.
    """
    if not isinstance(value, int | float) or isinstance(value, bool) or _is_item(location):
        return ""
    key = str(location[-1])
    rules = _section_of(location, model).model_fields[key].metadata
    for suffix, (unit, factor) in _UNITS.items():
        if not key.endswith(suffix) or abs(value) > 1e9:
            continue
        meant = value * factor
        if all(
            getattr(rule, "gt", -math.inf) < meant < getattr(rule, "lt", math.inf)
            and getattr(rule, "ge", -math.inf) <= meant <= getattr(rule, "le", math.inf)
            for rule in rules
        ):
            return f"; {value:g} {unit} are {meant:.6g} {suffix[1:]}"
    return ""


def explain_toml(error: ValueError, text: str) -> str:
    """What keeps a text from being TOML, by its line, with a guess."""
    if text.startswith("\ufeff"):
        return "line 1 begins with a byte-order mark: save it as UTF-8 without one (BOM)"
    if "\0" in text:
        return f"line {text[: text.index(chr(0))].count(chr(10)) + 1}: this is not a text file"
    lines = text.splitlines()
    seen: dict[tuple[str, ...], int] = {}
    for number, names in _paths(text, None):
        path = tuple(names)
        if lines[number - 1].lstrip().startswith("[["):  # another item, which restarts
            seen = {other: line for other, line in seen.items() if other[: len(path)] != path}
            continue
        first = seen.setdefault(path, number)
        if first != number:
            return f"line {number}: {'.'.join(path)} is set twice, first in line {first}"
    found = re.search(r"line (\d+)", str(error))
    unclosed = [line for line in lines if re.search(_OPEN_QUOTE, line)]
    wrong = lines[int(found[1]) - 1 :][:1] if found else unclosed
    hints = (words for each in wrong for pattern, words in _SYNTAX if re.search(pattern, each))
    return ": ".join([str(error), *itertools.islice(hints, 1)])


def _suggestion(location: list[int | str], model: type[BaseModel]) -> str:
    """What the user may have meant: another unit or spelling, or a setting of another table."""
    unknown = str(location[-1])
    section = _section_of(location, model)
    known = list(section.model_fields)
    stem = unknown.rpartition("_")[0]
    same = [name for name in known if stem and name.rpartition("_")[0] == stem]
    if elsewhere := _tables_of(unknown, model):
        return f"; it belongs in {' or '.join(f'[{table}]' for table in elsewhere[:3])}"
    if same:
        return f"; the unit is wrong: write {same[0]}"
    near = difflib.get_close_matches(unknown.lower(), known, 1)
    return f"; did you mean {near[0]}?" if near else f"; known here: {', '.join(known)}"


def _tables_of(key: str, model: type[BaseModel], table: str = "") -> list[str]:
    """The tables that have a setting of this name."""
    found = [table] if table and key in model.model_fields else []
    for name, field in model.model_fields.items():
        for section in _sections(field.annotation):
            found += _tables_of(key, section, f"{table}.{name}".lstrip("."))
    return found


def _section_of(location: list[int | str], model: type[BaseModel]) -> type[BaseModel]:
    """The table in which the setting at `location` is, or should be."""
    for part in location[:-1]:
        if isinstance(part, str):
            model = next(_sections(model.model_fields[part].annotation))
    return model


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
