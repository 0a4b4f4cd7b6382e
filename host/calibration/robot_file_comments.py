"""The comment behind a number of robot.toml that changes: the same value in another unit."""

import re
from typing import Any

from tomlkit.items import Float, Integer

from host.calibration.result import SCREEN_UNITS

_FIGURE = re.compile(rf"(?<![\w.])(-?\d+(?:\.(\d+))?)(\s*)({'|'.join(SCREEN_UNITS)})(?!\w)")


def update_comment(item: Any, before: Any, value: Any) -> None:
    """Keep the comment behind a changed number true, and where it stood."""
    if not isinstance(item, Integer | Float) or not isinstance(before, Integer | Float):
        return
    trivia = item.trivia
    if not trivia.comment:
        return
    gap = len(trivia.comment_ws) + len(before.as_string()) - len(item.as_string())
    trivia.comment_ws = " " * max(2, gap)

    def figure(match: re.Match[str]) -> str:
        shown, decimals, space, unit = match.groups()
        factor = SCREEN_UNITS[unit]
        places = len(decimals or "")
        if abs(float(shown) - before * factor) > 0.51 * 10.0**-places:
            return match[0]  # of something else
        return f"{value * factor:.{max(places, 1)}f}{space}{unit}"

    trivia.comment = _FIGURE.sub(figure, trivia.comment)
