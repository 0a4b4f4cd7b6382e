"""Tables of text as trackers and spreadsheets write them.

UTF-8 or UTF-16; comma, semicolon or tab between cells; a point or a comma before decimals.
"""

import codecs
import csv
import io
import math
from pathlib import Path

from host.errors import UserError

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_DELIMITERS = ",;\t"


def read_rows(path: Path, next_step: str) -> tuple[list[list[str]], bool]:
    """The cells of each line, and whether the last line is ended.

    The delimiter is the first of comma, semicolon and tab in the first line that has one and is no
    comment.
    next_step: of the UserError where the file cannot be read as a table.
    """
    try:
        data = path.read_bytes()
        text = data.decode(_encoding(data))
        lines = (line for line in text.splitlines() if line.strip(_DELIMITERS + " "))
        cells = "".join(line for line in lines if not line.lstrip().startswith("#"))
        delimiter = next((letter for letter in cells if letter in _DELIMITERS), ",")
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not a text file"
        raise UserError(f"cannot read {path}", why or str(error), next_step) from error
    return rows, text.endswith(("\n", "\r"))


def is_comment(row: list[str]) -> bool:
    """Whether a row holds nothing, or begins with #."""
    return not any(cell.strip() for cell in row) or row[0].lstrip().startswith("#")


def _encoding(data: bytes) -> str:
    if data.startswith(_UTF16):
        return "utf-16"
    if data[1:2] == b"\0":  # ASCII letters in UTF-16 without a mark
        return "utf-16-le"
    return "utf-16-be" if data[:1] == b"\0" else "utf-8-sig"


def number_of(cell: str) -> float:
    """The number in a cell; nan where it is blank. Raises ValueError for anything else."""
    cell = cell.strip()
    return float(cell.replace(",", ".")) if cell else math.nan


def wrong_line(path: Path, line: int, why: str, next_step: str = "") -> UserError:
    """The error of a line that cannot be read."""
    return UserError(
        f"{path}, line {line} cannot be read",
        why,
        next_step or "correct the line, or export the file again",
    )
