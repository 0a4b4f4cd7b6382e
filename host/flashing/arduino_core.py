"""An Arduino core as installed: the commands that its platform.txt and boards.txt prescribe."""

import re
import shlex
from collections.abc import Mapping
from pathlib import Path

DEBIAN = Path("/usr/share/arduino/hardware/arduino/avr")
BOARD = "leonardo"

# What the Arduino IDE would add, and what the core's own files need with Debian's GCC 5.4:
# without a value for DECIMAL_DIG its WString.cpp does not compile.
_GIVEN = {
    "runtime.ide.version": "10819",
    "build.arch": "AVR",
    "compiler.cpp.extra_flags": "-std=gnu++14 -DDECIMAL_DIG=__DECIMAL_DIG__",
}
_REFERENCE = re.compile(r"\{([\w.]+)\}")


class ArduinoCore:
    """The core in a folder, for one of its boards. Raises OSError if it is absent."""

    def __init__(self, folder: Path = DEBIAN, board: str = BOARD) -> None:
        self.descriptions = (folder / "platform.txt", folder / "boards.txt")
        platform, boards = (properties(path.read_text("utf-8")) for path in self.descriptions)
        mark = f"{board}."
        ours = {
            key.removeprefix(mark): text for key, text in boards.items() if key.startswith(mark)
        }
        self._properties = platform | ours | _GIVEN
        self.core = folder / "cores" / self.property("build.core")
        self.variant = folder / "variants" / self.property("build.variant")

    def property(self, key: str, values: Mapping[str, str] | None = None) -> str:
        """A property with every {reference} in it replaced; `values` go before the files'.

        Raises KeyError for a property that neither has.
        """
        known = {**self._properties, **(values or {})}

        def expand(text: str) -> str:
            return _REFERENCE.sub(lambda found: expand(known[found[1]]), text)

        return expand(known[key])

    def command(self, recipe: str, values: Mapping[str, str]) -> list[str]:
        """The words of a recipe's command ("c.o", "cpp.o", "ar", ...).

        values: properties that this one command has, such as source_file.
        """
        return shlex.split(self.property(f"recipe.{recipe}.pattern", values))


def properties(text: str) -> dict[str, str]:
    """Keys and values of a platform.txt or boards.txt: one key=value a line, # for comments."""
    lines = (line.strip() for line in text.splitlines())
    pairs = (line.partition("=") for line in lines if "=" in line and not line.startswith("#"))
    return {key.strip(): value.strip() for key, _, value in pairs}
