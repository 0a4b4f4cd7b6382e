"""The settings of a scenario as users write them: `arena4:seconds=60,seed=1`, within bounds."""

from dataclasses import Field, field, fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

from host.errors import UserError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

AnyScenario = TypeVar("AnyScenario", bound="DataclassInstance")


def bounded(default: Any, low: float, high: float) -> Any:
    """A scenario's field that users can set to a number from `low` to `high`."""
    return field(default=default, metadata={"bounds": (low, high)})


def one_of(words: tuple[str, ...]) -> Any:
    """A scenario's field that users can set to one of `words`; the first is the default."""
    return field(default=words[0], metadata={"words": words})


def with_settings(scenario: AnyScenario, text: str) -> AnyScenario:
    """The scenario with what `text`, NAME:KEY=VALUE,..., sets.

    Raises UserError that names what is known, or the bound that a value breaks.
    """
    known = {each.name: each for each in fields(scenario) if each.metadata}
    changes = {key: _value(known, key, value, text) for key, value in settings(text).items()}
    return replace(scenario, **changes)


def settings(text: str) -> dict[str, str]:
    """Return what a scenario as users write it sets itself. Raises UserError on a repetition."""
    found: dict[str, str] = {}
    given = text.partition(":")[2]
    for setting in given.split(",") if given else ():
        key, _, value = (part.strip() for part in setting.partition("="))
        if key in found:
            raise UserError(f"scenario {text!r} sets {key} twice", "", "keep one of the two")
        found[key] = value
    return found


def _value(known: dict[str, Field[Any]], key: str, value: str, text: str) -> int | float | str:
    if key not in known:
        raise UserError(
            f"scenario {text!r} has no setting {key!r}",
            f"known: {', '.join(sorted(known))}",
            f"write settings as in {text.partition(':')[0]}:seconds=60,seed=1",
        )
    if "words" in known[key].metadata:
        return _word(key, value, text, known[key].metadata["words"])
    low, high = known[key].metadata["bounds"]
    kind = int if known[key].type is int else float
    try:
        number = kind(value)
    except ValueError:
        number = None
    # Written so that nan, which compares false with everything, is refused too.
    if number is None or not low <= number <= high:
        what = "a whole number" if kind is int else "a number"
        raise UserError(
            f"scenario {text!r}: {key} cannot be {value!r}",
            f"it is {what} from {low} to {high}",
            f"write it as in {key}={known[key].default}",
        )
    return number


def _word(key: str, value: str, text: str, words: tuple[str, ...] | None) -> str:
    """words: the only ones there are; None: whoever uses it knows them."""
    if words is not None and value not in words:
        raise UserError(
            f"scenario {text!r}: {key} cannot be {value!r}",
            f"it is one of {', '.join(words)}",
            f"write it as in {key}={words[-1]}",
        )
    return value
