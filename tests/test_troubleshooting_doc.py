"""docs/troubleshooting.md, docs/bringup.md: their words are the program's."""

import ast
import re
from pathlib import Path

from tools.bring_up import answers, layout, steps

ROOT = Path(__file__).resolve().parents[1]
# Made of parts that the program fills in.
FILLED = {
    "swarmloc needs Python 3.11 or newer": "swarmloc needs Python 3.",
    "the left encoder is reversed": " reversed",
    "the left motor is reversed": " reversed",
    "late against the wheels": " against the wheels",
    "NAME has it open": "has it open",
    "it is not in the group dialout": "it is not in the group",
    "it joined the group dialout after it logged in": "after it logged in",
    "is one of 2 ports with its USB id": "ports with its USB id",
    "the firmware counts 2 edges ... as for 4 edges": "as for",
    "firmware speaks ..., host speaks ...": "firmware speaks",
    "packets come from ... instead": "instead, which may be its other interface",
    "not as a YDLidar X4 does at 128000 baud": "not as a YDLidar X4 does at",
}


def spoken(folders: tuple[str, ...]) -> list[str]:
    files = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    return [
        node.value
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ] + [(ROOT / "tools/setup").read_text("utf-8")]


def test_what_the_doctor_says_is_what_it_says() -> None:
    page = (ROOT / "docs/troubleshooting.md").read_text("utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    phrases = [phrase for row in rows for phrase in re.findall(r"`([^`]+)`", row)]
    assert len(phrases) > 40
    said = spoken(("host", "tools"))
    missing = [p for p in phrases if not any(FILLED.get(p, p) in text for text in said)]
    assert missing == []


def test_the_table_of_steps_is_the_scripts() -> None:
    page = (ROOT / "docs/bringup.md").read_text("utf-8")
    table = page.partition("| step | changes |")[2].partition("\n\n")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == list(steps.STEPS)
    for path in (layout.PREFIX, layout.COMMAND, layout.RULES, layout.ROBOT, layout.UNIT_FILE):
        assert path in table
    for package in layout.PACKAGES:
        assert package in table
    example = page.partition("```toml\n")[2].partition("```")[0]
    for name in re.findall(r"^(\w+) =", example, re.MULTILINE):
        assert name in answers.QUESTIONS
