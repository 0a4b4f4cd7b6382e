"""What is wrong in a robot.toml, as text: the key, its line, the bound, and a guess."""

import datetime
import difflib
import math
import re
import typing
from collections.abc import Iterator, Sequence

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from host.config.syntax import line_of

_DEG = math.pi / 180.0
# Other units that are written for that of a key, and what one of them is in it.
_UNITS = {
    "_radps": {"deg/s": _DEG},
    "_rad": {"deg": _DEG},
    "_mps": {"mm/s": 1e-3, "cm/s": 1e-2},
    "_m": {"mm": 1e-3, "cm": 1e-2},
    "_s": {"ms": 1e-3},
}
_SHOWN_UNITS = {"_radps": "rad/s", "_mps": "m/s"}
_SHARES = ("_probability", "_share", "_weight", "_min")
_ROTATIONS = {"_rad": math.tau, "_deg": 360.0}
_A_UNIT = re.compile(r"_(m|[cmu]m|rad|deg|s|[mu]s|k?hz|px|mps|cmps|mmps|kmh|radps|degps|mps2)$")
NOT_REGISTERED = "not_registered"  # the type of a validation error: a name without an entry
_SHOWN_SETTINGS, _SHOWN_LETTERS = 5, 60
_KINDS = {
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "string_too_short": "text that is not empty",
    "tuple_type": "a list of tables: write [[{key}]] above each",
}


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
    where = key if text is None else f"line {line_of(location, text)}: {key}"
    match detail["type"]:
        case "extra_forbidden":
            return f"{where}: no such setting{_suggestion(location, model, detail['input'])}"
        case "missing":
            return f"{where} is missing"
        case "model_type":
            table = f"[[{'.'.join(map(str, location[:-1]))}]]" if _is_item(location) else f"[{key}]"
            return f"{where} must be a table: write {table} above its settings"
        case "value_error":
            words = str(detail["ctx"]["error"])
            if text is not None:  # words about two settings begin with the names of both
                names = [found.split(".") for found in re.findall(r"\w[\w.]*", words)]
                lines = [line_of([*location, *name], text) for name in names]
                where = f"line {max(lines, default=line_of(location, text))}: {key}"
            return f"{where}: {words}" if key else f"{where}{words}"
    value = detail["input"]
    kind = _KINDS.get(detail["type"], "").format(key=key)
    words = f"must be {kind}" if kind else re.sub("^(Input|String) should", "must", detail["msg"])
    if "number" in kind and isinstance(value, str | float):
        words += ", without quotes and unit" if isinstance(value, str) else ", without a point"
    words += _unit_hint(location, value, model)
    given = "" if _is_secret(location, model) else f" = {_shown(_as_toml(value))}"
    return f"{where}{given}: {words[:1].lower()}{words[1:]}"


def _is_secret(location: list[int | str], model: type[BaseModel]) -> bool:
    """Whether its value is not to be seen, as the link's key: errors are shown to others."""
    field = _section_of(location, model).model_fields.get(str(location[-1]))
    return field is not None and not field.repr


def _is_item(location: list[int | str]) -> bool:
    return isinstance(location[-1], int)


def _as_toml(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case datetime.date() | datetime.time():
            return value.isoformat()
    return repr(value)


def _shown(text: str) -> str:
    """Text from the file, without what would write over the screen or fill it."""
    clean = "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)
    return clean if len(clean) <= _SHOWN_LETTERS else f"{clean[:_SHOWN_LETTERS]}…"


def _unit_hint(location: list[int | str], value: object, model: type[BaseModel]) -> str:
    """What the user may have meant by a number out of bounds, where that is within them."""
    if not isinstance(value, int | float) or isinstance(value, bool) or _is_item(location):
        return ""
    key = str(location[-1])
    rules = _section_of(location, model).model_fields[key].metadata
    if not abs(value) <= 1e9 or not any(map(_is_bound, rules)):
        return ""
    return "".join(
        f"; {next(words for words, meant in readings if _allowed(meant, rules))}"
        for readings in _readings(key, value)
        if any(_allowed(meant, rules) for _, meant in readings)
    )


def _is_bound(rule: object) -> bool:
    return any(hasattr(rule, side) for side in ("gt", "ge", "lt", "le"))


def _allowed(value: float, rules: Sequence[object]) -> bool:
    return all(
        getattr(rule, "gt", -math.inf) < value < getattr(rule, "lt", math.inf)
        and getattr(rule, "ge", -math.inf) <= value <= getattr(rule, "le", math.inf)
        for rule in rules
    )


def _readings(key: str, value: float) -> Iterator[list[tuple[str, float]]]:
    """Other readings of a number, in words and in the key's unit; in a list, the likely first."""
    if "_per_" in key:  # of a rate, the last is not the unit
        return
    suffix = next((each for each in _UNITS if key.endswith(each)), "")
    rotation = next((whole for unit, whole in _ROTATIONS.items() if key.endswith(unit)), 0.0)
    if 0.0 < abs(value) <= rotation:
        unit, meant = key.rpartition("_")[2], value - math.copysign(rotation, value)
        yield [(f"{value:g} {unit} and {meant:.6g} {unit} are one direction", meant)]
    unit = _SHOWN_UNITS.get(suffix, suffix[1:])
    yield [
        (f"{value:g} {other} are {value * factor:.6g} {unit}", value * factor)
        for other, factor in _UNITS.get(suffix, {}).items()
    ]
    if key.endswith("_hz") and value > 0.0:
        yield [(f"a period of {value:g} s is {1.0 / value:.6g} Hz", 1.0 / value)]
    if key.endswith(_SHARES) and 1.0 < value <= 100.0:
        yield [(f"{value:g} % are {value / 100.0:g}", value / 100.0)]


def _suggestion(location: list[int | str], model: type[BaseModel], value: object) -> str:
    """What the user may have meant: another unit or spelling, or a setting of another table."""
    unknown = str(location[-1])
    known = list(_section_of(location, model).model_fields)
    stem = _A_UNIT.sub("", unknown)
    same = [name for name in known if _A_UNIT.sub("", name) == stem and _A_UNIT.search(name)]
    if elsewhere := _tables_of(unknown, model, isinstance(value, dict)):
        tables = " or ".join(f"[{table}]" for table in elsewhere[:3])
        return f"; write {tables}" if isinstance(value, dict) else f"; it belongs in {tables}"
    if same:
        return f"; its unit is {'wrong' if stem != unknown else 'missing'}: write {same[0]}"
    near = difflib.get_close_matches(unknown.lower(), known, 1)
    return f"; did you mean {near[0]}?" if near else f"; known here: {', '.join(known)}"


def _tables_of(key: str, model: type[BaseModel], table: bool, path: str = "") -> list[str]:
    """The tables that have a setting of this name, or that are called so themselves."""
    found = []
    for name, field in model.model_fields.items():
        deeper = list(_sections(field.annotation))
        here = f"{path}.{name}".lstrip(".")
        if name == key and path and bool(deeper) == table:
            found.append(here if table else path)
        for section in deeper:
            found += _tables_of(key, section, table, here)
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
