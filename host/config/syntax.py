"""The text of a robot.toml: where a key is in it, and what keeps a text from being TOML."""

import itertools
import re
from collections.abc import Iterator

_TEXT = r"(\"[^\"]*\"|'[^']*')"
_NUMBER = r"[-+]?[\d.]+"
_OPEN_QUOTE = r"=\s*(\"[^\"]*|'[^']*)$"
# What a line that is not TOML looks like, and what to write instead: the first that fits.
_SLIPS = (
    (r"[“”„‘’«»]", 'write straight quotes, as name = "five"'),
    (rf"^\s*(//|;|--|/\*)|=\s*({_TEXT}|[\w.+-]+)\s*(//|;\s*\w)", "write # before a comment"),
    (r"^\s*=", "the key is missing: write key = value"),
    (r"^\s*[{}]", "write key = value, one a line, and [table] above those of a table"),
    (r"^\s*[\w.-]+\s*(:|=[=>])", "write = between a key and its value"),
    (r"^\s*[\w.-]+\s*(=\s*)?(#.*)?$", "the value is missing: write key = value"),
    (r"^\s*[\w.-]+\s+[^\s=][^=]*$", "write = between a key and its value"),
    (r"^\s*\w+ +\w+\s*=", "write a key without spaces, as track_m"),
    (r"^\s*\[\[?\s*\]", "the table's name is missing, as in [lidar]"),
    (r"(^|=)\s*\[[^\]]*$", "a ] is missing"),
    (r"^\s*(\[[^\[\]]*\]\]|\[\[[^\]]*\](?!\]))", "write [table], or [[table]] for one of a list"),
    (r"^\s*\[.*\]\s*[^\s#\]]", "write [table] on a line of its own"),
    (r"=\s*\"[^\"]*\\", "write \\\\ for each \\, or the text in single quotes"),
    (
        rf"=\s*{_TEXT}\s*[^\s#,;\]}}\"']",
        "the text ends at its second quote: use the other kind of quotes",
    ),
    (_OPEN_QUOTE, "the quote at the end is missing"),
    (rf"=\s*({_TEXT}|[\w.+-]+)\s*[,;]\s*(#.*)?$", "remove the comma or semicolon at the end"),
    (r",\s*\}", "remove the comma before the }"),
    (r"\{[^}]*$", "write { ... } on one line"),
    (r"=\s*[-+]?\d+,\d", "write decimals with a point, as 0.5"),
    (r"=\s*[-+]?(\.\d|\d+\.(\D|$))", "write digits before and after the point, as 0.5"),
    (r"=\s*[-+]?0\d", "write the number without the 0 in front"),
    (rf"=\s*({_NUMBER}|[-+]?pi)\s*[*/+-]", "write the result: nothing is calculated here"),
    (rf"=\s*{_NUMBER}\s+[-+]?[\d.]", "write one number"),
    (rf"=\s*{_NUMBER}\s*[A-Za-z°µ]", "write the number alone: its unit is that of the key"),
    (r"=\s*(?i:true|false|yes|no|on|off)\b", "write true or false, in small letters"),
    (r"=\s*(?i:nan|inf|infinity|none|null|nil)\b", "write a number, or leave the line out"),
    (r"=\s*[A-Za-z/.]", 'write text in quotes, as name = "five"'),
)


def explain_toml(error: ValueError, text: str) -> str:
    """What keeps a text from being TOML, by its line, with a guess."""
    if text.startswith("\ufeff"):
        return "line 1 begins with a byte-order mark: save it as UTF-8 without one (BOM)"
    if "\0" in text:
        return f"line {text[: text.index(chr(0))].count(chr(10)) + 1}: this is not a text file"
    if twice := _set_twice(text):
        return twice
    lines = text.split("\n")
    found = re.search(r"line (\d+)", str(error))
    number = int(found[1]) if found else _unclosed(lines)
    hints = (words for pattern, words in _SLIPS if re.search(pattern, lines[number - 1]))
    what = str(error) if found else f"line {number}: {error}"
    return ": ".join([what, *itertools.islice(hints, 1)])


def _unclosed(lines: list[str]) -> int:
    """The line from which something is open until the end of the text, as far as can be seen."""
    for mark in ('"""', "'''"):
        odd = [number for number, line in enumerate(lines, 1) if line.count(mark) % 2]
        if len(odd) % 2:
            return odd[-1]
    opened = [n for n, line in enumerate(lines, 1) if re.search(rf"=\s*[\[{{]|{_OPEN_QUOTE}", line)]
    last = max(n for n, line in enumerate(lines, 1) if line.strip() or n == 1)
    return opened[-1] if opened else last


def _set_twice(text: str) -> str:
    """The first key or table that is set a second time, in words; "" where none is."""
    lines = text.split("\n")
    seen: dict[tuple[str, ...], int] = {}
    implied: dict[tuple[str, ...], int] = {}  # the tables that dotted keys make
    table: tuple[str, ...] = ()
    for number, names in paths(text, None):
        path = tuple(names)
        header = lines[number - 1].lstrip().startswith("[")
        parents = [] if header else [path[:n] for n in range(len(table) + 1, len(path))]
        table = path if header else table
        if lines[number - 1].lstrip().startswith("[["):  # another item, which restarts
            seen = {other: line for other, line in seen.items() if other[: len(path)] != path}
            continue
        twice = [each for each in (path, *parents) if each in seen or (header and each in implied)]
        if twice:
            first = seen.get(twice[0]) or implied[twice[0]]
            return f"line {number}: {'.'.join(twice[0])} is set twice, first in line {first}"
        seen[path] = number
        implied |= dict.fromkeys(parents, number)
    return ""


def line_of(location: list[int | str], text: str) -> int:
    """The line (from 1) of the key at `location`; that of its table where the key is missing.

    The TOML reader of the standard library keeps no positions, so the headers are followed here.
    """
    names = [str(part) for part in location if isinstance(part, str)]
    item = next((part for part in location if isinstance(part, int)), None)
    best = (0, 1)
    for number, path in paths(text, item):
        common = min(len(path), len(names))  # a header may go deeper than the unknown table
        if path[:common] == names[:common] and common > best[0]:
            best = (common, number)
    return best[1]


def paths(text: str, item: int | None) -> Iterator[tuple[int, list[str]]]:
    """Line and full path of each header and key; of repeated tables, only of `item` (from 0)."""
    table: list[str] = []
    items: dict[str, int] = {}
    for number, line in enumerate(text.split("\n"), 1):
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
