"""Records of trials in a file, one line of JSON each, so that what is done is never done again."""

import json
from collections.abc import Iterable
from pathlib import Path

from host.errors import UserError
from host.experiments.trials import Record, Trial


class Records:
    """The records of a file by their key; each new one is appended at once.

    A last line that was torn by a crash is dropped. Raises UserError for a file that holds
    anything else or cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._by_key: dict[str, Record] = {}
        lines = self._read().split("\n")
        for number, line in enumerate(lines[:-1], start=1):
            record = _parsed(line, path, number)
            self._by_key[record["key"]] = record
        if lines[-1]:
            self._write(self._by_key.values())

    def __contains__(self, trial: Trial) -> bool:
        return trial.key() in self._by_key

    def of(self, trials: Iterable[Trial]) -> list[Record]:
        """The records of those trials that are done, in the trials' order."""
        keys = [trial.key() for trial in trials]
        return [self._by_key[key] for key in keys if key in self._by_key]

    def add(self, record: Record) -> None:
        """Append a record."""
        self._by_key[record["key"]] = record
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(_line(record))
        except OSError as error:
            raise _unusable(self._path, error) from error

    def everything(self) -> list[Record]:
        """Every record, in the file's order."""
        return list(self._by_key.values())

    def replace(self, records: Iterable[Record]) -> None:
        """Write the file again with these records and no others."""
        self._by_key = {record["key"]: record for record in records}
        self._write(self._by_key.values())

    def _read(self) -> str:
        try:
            return self._path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return ""
        except (OSError, UnicodeDecodeError) as error:
            raise _unusable(self._path, error) from error

    def _write(self, records: Iterable[Record]) -> None:
        fresh = self._path.with_name(self._path.name + ".new")
        try:
            fresh.write_text("".join(map(_line, records)), encoding="utf-8")
            fresh.replace(self._path)
        except OSError as error:
            raise _unusable(self._path, error) from error


def _line(record: Record) -> str:
    return json.dumps(record, allow_nan=False) + "\n"


def _parsed(line: str, path: Path, number: int) -> Record:
    try:
        record: Record = json.loads(line)
        if "key" in record:
            return record
    except (ValueError, TypeError):
        pass
    raise UserError(
        f"{path} holds no records of trials",
        f"line {number} is none",
        "name another file, or move this one away",
    )


def _unusable(path: Path, error: OSError | UnicodeDecodeError) -> UserError:
    why = error.strerror if isinstance(error, OSError) else None
    return UserError(f"cannot use {path}", why or str(error), "name another file")
