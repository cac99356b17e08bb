"""A data folder is its owner's alone, whatever it was before."""

import contextlib
import os
import stat
import subprocess
from pathlib import Path

import pytest

from apexcal.embedded.folder import DataFolder
from tests.apexcal.test_cli import program
from tests.support.served import SERVE, Embedded


def open_to_others(path: Path) -> bool:
    with contextlib.suppress(FileNotFoundError):  # a service that runs removes files
        return stat.S_IMODE(path.lstat().st_mode) & 0o077 != 0
    return False


@pytest.mark.parametrize("mode", [0o755, 0o750, 0o770, 0o777, 0o701])
def test_an_open_folder_is_closed_when_it_is_taken(tmp_path: Path, mode: int) -> None:
    (tmp_path / "apexcal.db").touch()
    tmp_path.chmod(mode)
    folder = DataFolder(tmp_path)
    assert folder.hold() and not open_to_others(tmp_path)
    folder.release()
    assert not folder.hold(), "it is closed already"
    folder.release()


def test_all_that_is_made_in_a_folder_that_was_open_is_its_owners_alone(embedded: Embedded) -> None:
    assert not open_to_others(embedded.data)
    made = [path for path in embedded.data.rglob("*") if not path.is_symlink()]
    assert {"apexcal.db", "owner.token", "logs", "api.log", "blobs"} <= {path.name for path in made}
    assert not [path for path in made if open_to_others(path)], "even where the folder is opened later"


def test_a_backup_is_its_owners_alone(embedded: Embedded, tmp_path: Path) -> None:
    target = tmp_path / "backup"
    done = program("admin", "backup", target, "--data", embedded.data)
    assert done.returncode == 0, done.stderr
    made = [target, *target.rglob("*")]
    assert {"rows.sqlite", "blobs"} <= {path.name for path in made}
    assert not [path for path in made if open_to_others(path)]


def refusal(data: Path, **options: object) -> str:
    refused = subprocess.run([*SERVE, "--data", str(data)], capture_output=True, text=True, **options)
    assert refused.returncode == 1 and "Traceback" not in refused.stderr
    return " ".join(refused.stderr.split())


def test_an_open_folder_of_other_things_is_left_alone_and_refused(tmp_path: Path) -> None:
    data = tmp_path / "public"
    data.mkdir(mode=0o755)
    data.chmod(0o755)
    (data / "index.html").touch()
    said = refusal(data)
    assert "chmod 700" in said and "other users may read" in said and "--data" in said
    assert stat.S_IMODE(data.stat().st_mode) == 0o755
    assert [path.name for path in data.iterdir()] == ["index.html"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_an_open_folder_of_somebody_else_is_refused(tmp_path: Path) -> None:
    data = tmp_path / "theirs"
    data.mkdir()
    data.chmod(0o777)
    os.chown(data, 65534, 65534)
    assert "another user" in refusal(data)
    assert list(data.iterdir()) == []
