"""What the tables of robot.toml have in common."""

from collections.abc import Callable
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError

from host.config.errors import NOT_REGISTERED
from host.registry import Registry

RECORDED = {"recorded": True}
"""The validation context of a recording's settings."""


def _printable(text: str) -> str:
    """The text. Raises ValueError for control characters, which would write over the screen."""
    wrong = next((letter for letter in text if not letter.isprintable()), None)
    if wrong is not None:
        raise ValueError(f"it holds the control character {wrong!r}: remove it")
    return text


def _trimmed(text: str, info: ValidationInfo) -> str:
    if text != text.strip() and info.context != RECORDED:
        raise ValueError("it begins or ends with a blank: remove it")
    return text


def _source(word: str, example: str) -> AfterValidator:
    """A check of where a device's data come from: a path, or the one `word` that is none."""

    def check(text: str, info: ValidationInfo) -> str:
        slip = text.lower() in ("auto", "none", "off") or text.isdecimal()
        if slip and text != word and info.context != RECORDED:
            raise ValueError(f'{text!r} must be a path, as "{example}", or "{word}"')
        return text

    return AfterValidator(check)


# TOML has lists; the configuration, which does not change, has tuples.
listed = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Line = Annotated[str, Field(max_length=200), AfterValidator(_printable), AfterValidator(_trimmed)]
Text = Annotated[
    str,
    Field(min_length=1, max_length=200),
    AfterValidator(_printable),
    AfterValidator(_trimmed),
]
Port = Annotated[Text, _source("auto", "/dev/ttyUSB0")]
Pictures = Annotated[Text, _source("none", "/dev/video0")]


class Section(BaseModel):
    """A table of robot.toml: immutable, unknown keys refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


def registered(registry: Registry) -> Callable[[str], str]:
    """A check that a name is in the registry."""

    def check(name: str) -> str:
        if name not in registry.names():
            known = ", ".join(registry.names())
            raise PydanticCustomError(
                NOT_REGISTERED,
                "no {kind} is called so; known: {known}; one of your own needs --plugin",
                {"kind": registry.kind, "known": known},
            )
        return name

    return check


_Table = TypeVar("_Table", bound=Section)


def contradiction(check: Callable[[_Table], None]) -> Any:
    """A validator of a table that refuses contradictions, by `check` raising ValueError.

    Not in a recording: its settings are as they were.
    """

    def checked(table: _Table, info: ValidationInfo) -> _Table:
        if info.context != RECORDED:
            check(table)
        return table

    return model_validator(mode="after")(checked)
