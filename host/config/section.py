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


def _printable(text: str) -> str:
    """The text. Raises ValueError for control characters, which would write over the screen."""
    wrong = next((letter for letter in text if not letter.isprintable()), None)
    if wrong is not None:
        raise ValueError(f"it holds the control character {wrong!r}: remove it")
    return text


# TOML has lists; the configuration, which does not change, has tuples.
listed = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Text = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]


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


RECORDED = {"recorded": True}
"""The validation context of a recording's settings."""

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
