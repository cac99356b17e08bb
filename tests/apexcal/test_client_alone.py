"""The client alone: what `pip install apexcal` brings is enough to work with a service."""

import os
import re
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path
from typing import Final
from uuid import UUID

import pytest
from packaging.requirements import Requirement

import apexcal
from apexcal.cli import COMMANDS, UNREACHABLE

MOST_BYTES: Final = 30_000_000
PROGRAMS: Final = {name: command.extra for name, command in COMMANDS.items() if command.extra}


def _needed(name: str, found: set[str]) -> set[str]:
    """A distribution and all that it requires without extras."""
    if name not in found:
        found.add(name)
        for text in distribution(name).requires or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                _needed(requirement.name, found)
    return found


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds what the package requires, and of its own rooms `apexcal` alone."""
    folder = tmp_path_factory.mktemp("client")
    for name in _needed("apexcal", set()) - {"apexcal"}:
        one = distribution(name)
        for top in {file.parts[0] for file in one.files or () if file.parts[0] not in ("..", "__pycache__")}:
            if not (folder / top).exists():
                (folder / top).symlink_to(Path(str(one.locate_file(top))))
    (folder / "apexcal").symlink_to(Path(apexcal.__file__).parent)
    return folder


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `apexcal` with nothing but that folder and Python's own library."""
    code = f"import sys; sys.path.append({str(folder)!r}); from apexcal.cli import main; main()"
    command = (sys.executable, "-I", "-S", "-B", "-c", code, *words)
    return subprocess.run(command, capture_output=True, text=True, timeout=120, env={"HOME": os.environ["HOME"]})


def test_every_command_of_the_client_is_there(client: Path) -> None:
    loaded = "; ".join(f"import apexcal.commands.{command.module}" for command in COMMANDS.values())
    code = f"import sys; sys.path.append({str(client)!r}); import apexcal.client; {loaded}"
    done = subprocess.run((sys.executable, "-I", "-S", "-B", "-c", code), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    # Nobody listens there: the client gets as far as asking.
    asked = run(client, "export", "--url", "http://127.0.0.1:9", "--token", "apx_x", "--result", str(UUID(int=1)))
    assert asked.returncode == UNREACHABLE, asked.stderr


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_of_an_extra_says_how_to_install_it(client: Path, name: str) -> None:
    done = run(client, name, "--help")
    assert done.returncode == 1 and f"pip install 'apexcal[{PROGRAMS[name]}]'" in done.stderr, done.stderr


def test_the_client_is_light(client: Path) -> None:
    taken = sum(
        file.stat().st_size
        for top in client.iterdir()
        for file in (top.resolve().rglob("*") if top.is_dir() else [top])
        if file.is_file() and not re.search(r"\.pyc$", file.name)
    )
    assert taken < MOST_BYTES
