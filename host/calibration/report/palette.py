"""What each colour means: the same in every picture of every report.

Okabe and Ito's colours and two of Tol's, distinct for the colour-blind, too; markers make them
distinct in grey.
"""

from typing import NamedTuple

from host.calibration.result import Role


class Look(NamedTuple):
    """How points and lines of one role are drawn, and what the role is called."""

    colour: str
    marker: str
    meaning: str


ROLES: dict[Role, Look] = {
    "measured": Look("#0072b2", "o", "measured"),
    "refused": Look("#d55e00", "x", "measured, and left out"),
    "reference": Look("#1c2733", "D", "the reference"),
    "before": Look("#e69f00", "s", "by the values from before"),
    "fitted": Look("#009e73", "^", "by the fitted values"),
    "front": Look("#56b4e9", "o", "front camera"),
    "rear": Look("#cc79a7", "v", "rear camera"),
    "along": Look("#332288", "o", "along the line of sight"),
    "across": Look("#999933", "v", "across it"),
}
OTHERS = tuple(ROLES[role] for role in ("measured", "refused", "fitted", "rear", "front", "before"))
"""For pictures whose series have no role: one after another."""
