"""What tests do on a machine that lacks what builds the firmware: skip, and fail in CI."""

import os
from collections.abc import Callable
from typing import NoReturn, TypeVar

import pytest

from host.errors import UserError

T = TypeVar("T")


def missing(why: str) -> NoReturn:
    """Skip the test; fail it with CI=true, where everything has to run."""
    if os.environ.get("CI") == "true":
        pytest.fail(why)
    pytest.skip(why)


def needed(provide: Callable[[], T]) -> T:
    """What `provide` gives; where it raises UserError the test is over."""
    try:
        return provide()
    except UserError as error:
        missing(str(error))
