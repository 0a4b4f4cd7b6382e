"""The doctor's findings: ok, warning or failure, each with the next step."""

import textwrap
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from host.errors import UserError, one_line
from host.messages import Health

_WIDEST = 100


class Level(StrEnum):
    """How bad it is. A failed part does not do its work; one that is warned of does it worse."""

    OK = "ok"
    WARN = "warn"
    FAIL = "FAIL"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing about a part of the robot, as text. next_step: what to do where it is not ok."""

    part: str
    level: Level
    what: str
    next_step: str = ""


def failed(part: str, error: UserError) -> Finding:
    """The finding of an error."""
    why = "; ".join(one_line(text) for text in (error.what, error.why) if text)
    return Finding(part, Level.FAIL, why, error.next_step)


def of_health(health: Health) -> list[Finding]:
    """What a device's own Health says: its state, and each remark that follows after "; "."""
    part, lines = health.device, health.reason.splitlines()
    if not health.ok and len(lines) > 1:
        said = 1 if len(lines) == 2 else 2  # what to paste has lines of its own
        return [Finding(part, Level.FAIL, "; ".join(lines[:said]), "\n".join(lines[said:]))]
    how, *more = health.reason.split("; ")
    if not health.ok:
        return [Finding(part, Level.FAIL, *_with_step("; ".join([how, *more])))]
    remarks = [Finding(part, Level.WARN, *_with_step(remark)) for remark in more]
    return [Finding(part, Level.OK, how), *remarks]


_NOT_HELD = (
    "keep the light steady, or take another camera (v4l2-ctl --list-ctrls shows its controls)"
)


def _with_step(text: str) -> tuple[str, str]:
    """What a remark says, and what to do, which follows the last colon."""
    if " not held" in text:  # a control of a camera; after the colon is why
        return text, _NOT_HELD
    what, colon, step = text.rpartition(": ")
    return (what, step) if colon else (text, "")


def in_json(findings: Sequence[Finding]) -> dict[str, Any]:
    """The findings, and how many there are of each level."""
    return {
        "findings": [{**asdict(finding), "level": finding.level.lower()} for finding in findings],
        **{level.lower(): sum(f.level == level for f in findings) for level in Level},
    }


def table(findings: Sequence[Finding], width: int = _WIDEST) -> str:
    """The findings as lines of at most so many columns, part by part, next steps below."""
    part_width = max((len(finding.part) for finding in findings), default=0)
    indent = " " * (part_width + 8)
    lines, before = [], ""
    for finding in findings:
        name = "" if finding.part == before else finding.part
        before = finding.part
        lines += _wrapped(f"{name:{part_width}}  {finding.level:4}  {finding.what}", indent, width)
        for step in finding.next_step.splitlines():
            # What is to be pasted stays on one line.
            lines += (
                [indent + step]
                if step.startswith("  ")
                else _wrapped(f"{indent}-> {step}", indent + "   ", width)
            )
    return "\n".join(lines)


def _wrapped(text: str, indent: str, width: int) -> list[str]:
    return textwrap.wrap(
        text,
        max(width, 40),
        subsequent_indent=indent,
        break_on_hyphens=False,
        break_long_words=False,
    )
