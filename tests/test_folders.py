"""Where what is built goes: to a folder that this user can write, never into the program's."""

import os
import tempfile
from pathlib import Path

import pytest

from host import folders
from host.errors import UserError
from host.folders import build_folder, data_folder


@pytest.fixture
def unwritable(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither a cache nor a home; tmp_path is the folder for temporary files."""
    blocked = tmp_path / "a file, not a folder"
    blocked.touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    monkeypatch.setenv("HOME", str(blocked))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def test_the_cache_folder_is_the_one_that_the_user_names(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert build_folder() == tmp_path / "cache/swarmloc"
    assert build_folder().is_dir()


@pytest.mark.parametrize("named", ["", "relative/cache"])
def test_without_an_absolute_name_it_is_in_the_home_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, named: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", named)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert build_folder() == tmp_path / ".cache/swarmloc"


@pytest.mark.usefixtures("unwritable")
def test_a_user_without_a_home_gets_a_folder_of_his_own(tmp_path: Path) -> None:
    folder = build_folder()
    assert folder == tmp_path / f"swarmloc-{os.getuid()}"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert build_folder() == folder


@pytest.mark.usefixtures("unwritable")
def test_a_temporary_folder_that_others_may_fill_is_not_used(tmp_path: Path) -> None:
    folder = tmp_path / f"swarmloc-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o777)
    with pytest.raises(UserError, match="export XDG_CACHE_HOME"):
        build_folder()
    folder.rmdir()
    (tmp_path / "elsewhere").mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UserError, match="only this user can write"):
        build_folder()


@pytest.mark.usefixtures("unwritable")
def test_nothing_that_can_be_written_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "absent"))
    with pytest.raises(UserError, match="No such file or directory"):
        build_folder()


def test_the_data_are_beside_the_package_or_packed_into_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert (data_folder() / "firmware/simulator/romeo_simulator.c").is_file()
    package = tmp_path / "host"
    (package / "data").mkdir(parents=True)
    monkeypatch.setattr(folders, "_PACKAGE", package)
    assert data_folder() == package / "data"
