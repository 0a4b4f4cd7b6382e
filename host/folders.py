"""Where the program's own files are: the data that it comes with, and what it builds of them.

Nothing is ever written where the program is installed: that may be read-only, or another user's.
"""

import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from host.errors import UserError

_PACKAGE = Path(__file__).resolve().parent
_PROGRAM = "swarmloc"


def data_folder() -> Path:
    """The folder that holds firmware/ and robots/.

    In a checkout that is its top; in an installed package, where pyproject.toml puts them.
    """
    packed = _PACKAGE / "data"
    return packed if packed.is_dir() else _PACKAGE.parent


def build_folder() -> Path:
    """The folder for what is built: in the user's cache, made if absent. It may be deleted.

    That is swarmloc/ in XDG_CACHE_HOME or ~/.cache (XDG Base Directory Specification 0.8). For a
    user without a home that can be written, it is a folder of this user's own for temporary files.
    Raises UserError if that cannot be written either.
    """
    for folder in _caches():
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK | os.X_OK):
            return folder
    return _temporary()


def _caches() -> Iterator[Path]:
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if named.is_absolute():  # the specification: a relative one is to be ignored
        yield named / _PROGRAM
    try:
        yield Path.home() / ".cache" / _PROGRAM
    except RuntimeError:  # this user has no home at all
        return


def _temporary() -> Path:
    """A folder that no other user can put files into: what is built there is also executed."""
    folder = Path(tempfile.gettempdir()) / f"{_PROGRAM}-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise _no_folder(f"{folder}: {error.strerror}") from error
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise _no_folder(f"{folder} is not a folder that only this user can write")
    return folder


def _no_folder(why: str) -> UserError:
    return UserError(
        "there is no folder for what is built",
        f"neither the home folder nor the one for temporary files can be written ({why})",
        "name one that can: export XDG_CACHE_HOME=/path/to/folder",
    )
