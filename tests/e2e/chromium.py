"""A Chromium for the browser tests: the system's, or else the one that npm brought, unpacked once into var/."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tests.support.places import ROOT

PACKAGE = ROOT / "frontend" / "node_modules" / "@sparticuz" / "chromium"
SYSTEM = Path("/usr/bin/chromium")

# executablePath() unpacks into TMPDIR and takes what lies there already, half-written or not: it gets an empty one.
_UNPACK = """
import chromium, { inflate } from "@sparticuz/chromium";
await chromium.executablePath();
await inflate("node_modules/@sparticuz/chromium/bin/al2023.tar.br");
"""


class NoChromiumError(RuntimeError):
    """There is no browser to test with; the message says how to get one."""


@dataclass(frozen=True)
class Chromium:
    """An executable, and the environment that it needs."""

    executable: Path
    environment: Mapping[str, str]


def find_chromium() -> Chromium:
    """A Chromium that starts here. Raises :class:`NoChromiumError`."""
    if SYSTEM.exists():
        return Chromium(SYSTEM, dict(os.environ))
    folder = _unpacked()
    environment = dict(os.environ)
    if not Path("/etc/fonts/fonts.conf").exists():
        environment["FONTCONFIG_PATH"] = str(folder / "fonts")
    executable = folder / "chromium"
    if not _starts(executable, environment):
        # Without NSS and its kin in the system, the package's own libraries do.
        environment["LD_LIBRARY_PATH"] = str(folder / "al2023" / "lib")
        if not _starts(executable, environment):
            raise NoChromiumError(f"{executable} does not start on this machine; install the system's chromium.")
    return Chromium(executable, environment)


def _unpacked() -> Path:
    """The folder with npm's Chromium in it. Unpacked aside and then renamed, so that it is never half there."""
    if not PACKAGE.exists():
        raise NoChromiumError("There is neither /usr/bin/chromium nor npm's: run `make frontend` first.")
    version = json.loads((PACKAGE / "package.json").read_text())["version"]
    folder = ROOT / "var" / "chromium" / version
    if folder.exists():
        return folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    staged = Path(tempfile.mkdtemp(dir=folder.parent))
    try:
        subprocess.run(
            [Path(sys.executable).parent / "node", "--input-type=module", "-e", _UNPACK],
            cwd=ROOT / "frontend",
            env={**os.environ, "TMPDIR": str(staged)},
            check=True,
        )
        staged.rename(folder)
    except OSError:
        # Another test session was faster; its folder is as good.
        if not folder.exists():
            raise
    finally:
        shutil.rmtree(staged, ignore_errors=True)
    return folder


def _starts(executable: Path, environment: Mapping[str, str]) -> bool:
    asked = subprocess.run([executable, "--version"], env=environment, capture_output=True)
    return asked.returncode == 0
