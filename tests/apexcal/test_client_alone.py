"""The client alone: what `pip install apexcal` brings is enough to work with a service."""

import os
import re
import subprocess
import sys
import sysconfig
from importlib.metadata import distribution
from pathlib import Path
from typing import Final
from uuid import UUID

import pytest
from packaging.requirements import Requirement

import apexcal
from apexcal.cli import COMMANDS
from apexcal.commands.terminal import UNREACHABLE

MOST_BYTES: Final = 30_000_000
PROGRAMS: Final = {name: command.extra for name, command in COMMANDS.items() if command.extra}


def _needed(name: str, extras: tuple[str, ...], found: set[str]) -> set[str]:
    """A distribution and all that it requires with these extras, each with its own in brackets."""
    if name not in found:
        found.add(name)
        bare = name.partition("[")[0]
        for text in distribution(bare).requires or ():
            requirement = Requirement(text)
            marker = requirement.marker
            if marker is None or any(marker.evaluate({"extra": extra}) for extra in extras):
                own = tuple(requirement.extras)
                _needed(f"{requirement.name}[{','.join(own)}]", ("", *own), found)
    return found


def installed(folder: Path, *extras: str, packages: tuple[str, ...] = ("apexcal",)) -> Path:
    """A folder that holds what the package requires with these extras, and of its own these packages alone."""
    for name in {name.partition("[")[0] for name in _needed("apexcal", ("", *extras), set())} - {"apexcal"}:
        one = distribution(name)
        for top in {file.parts[0] for file in one.files or () if file.parts[0] not in ("..", "__pycache__")}:
            if not (folder / top).exists():
                (folder / top).symlink_to(Path(str(one.locate_file(top))))
    facts = next(Path(sysconfig.get_path("purelib")).glob("apexcal-*.dist-info"))
    (folder / facts.name).symlink_to(facts)
    for package in packages:
        (folder / package).symlink_to(Path(apexcal.__file__).parents[1] / package)
    return folder


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return installed(tmp_path_factory.mktemp("client"))


def program(folder: Path, code: str, *words: str) -> tuple[str, ...]:
    """Python's own library and that folder, and nothing else."""
    code = f"import sys; sys.path.append({str(folder)!r}); {code}"
    return (sys.executable, "-I", "-S", "-B", "-c", code, *words)


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `apexcal` with nothing but that folder and Python's own library."""
    command = program(folder, "from apexcal.cli import main; main()", *words)
    return subprocess.run(command, capture_output=True, text=True, env={"HOME": os.environ["HOME"]})


def test_every_command_of_the_client_is_there(client: Path) -> None:
    loaded = "; ".join(f"import apexcal.commands.{command.module}" for command in COMMANDS.values())
    command = program(client, f"import apexcal.client; {loaded}")
    done = subprocess.run(command, capture_output=True, text=True)
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


# What an image holds of ours, what it lacks, and what its process does before its work.
IMAGES: Final = {
    "serve": (
        ("service",),
        {"numba", "llvmlite", "scipy", "av", "workers"},
        "from service.platform.db.migrate import main; main([]); "
        "from service.app import create_app; create_app().openapi()",
    ),
    "worker": (("service", "workers"), {"fastapi", "uvicorn", "alembic"}, "import workers.app"),
}


@pytest.mark.parametrize("extra", IMAGES)
def test_an_image_needs_its_extra_alone(tmp_path: Path, extra: str) -> None:
    """The API migrates and describes itself; of its last package every module is imported."""
    packages, absent, begins = IMAGES[extra]
    (tmp_path / "image").mkdir()
    folder = installed(tmp_path / "image", extra, packages=("apexcal", *packages))
    assert not absent & {path.name for path in folder.iterdir()}
    root = Path(apexcal.__file__).parents[1]
    files = (file.relative_to(root).with_suffix("") for file in (root / packages[-1]).rglob("*.py"))
    left_out = {"__init__", "__main__", "migrations"}
    modules = [".".join(file.parts) for file in files if not left_out & {*file.parts}]
    code = f"{begins}; import importlib; [importlib.import_module(name) for name in sys.argv[1:]]"
    settings = {"APEXCAL_DATA_DIR": str(tmp_path / "data"), "APEXCAL_BROKER_URL": "redis://127.0.0.1:9/0"}
    env = {"HOME": os.environ["HOME"], **settings}
    done = subprocess.run(program(folder, code, *modules), capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr
