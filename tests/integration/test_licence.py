"""The licence travels with every form in which apexcal leaves the checkout: wheel, source archive, image, pages."""

import json
import re
import subprocess
import sys
import tarfile
import zipfile
from email.message import Message
from email.parser import Parser
from pathlib import Path

import pytest

from tests.support.notice import notice
from tests.support.places import ROOT

PAGES = ("service/web/index.html", "workers/reports/report.html")
TEXTS = {name: (ROOT / name).read_text() for name in ("LICENSE", "NOTICE")}
LICENCE = TEXTS["LICENSE"]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of both archives, built from a copy of what git holds, so that they hold nothing else."""
    copy, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("built")
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(("docs/", "tests/", "benchmarks/")):
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            (copy / name).write_bytes((ROOT / name).read_bytes())
    # The pages are not what is asked here: files in their place keep the build hook from building them.
    (copy / "service" / "web").mkdir(parents=True)
    for name in PAGES:
        (copy / name).write_text("<!doctype html>")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", str(out)], cwd=copy, check=True, capture_output=True
    )
    return out


def _holds(metadata: str) -> Message:
    message = Parser().parsestr(metadata)
    assert message["License-Expression"] == "Apache-2.0"
    assert message.get_all("License-File") == list(TEXTS)
    assert message["Author"] == "the apexcal authors"
    return message


def test_the_text_is_that_of_the_apache_foundation() -> None:
    assert LICENCE.lstrip().startswith("Apache License")
    for heading in ("TERMS AND CONDITIONS", "9. Accepting Warranty", "END OF TERMS AND CONDITIONS", "APPENDIX"):
        assert heading in LICENCE


def test_the_wheel_holds_it(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (info,) = {name.split("/")[0] for name in archive.namelist() if ".dist-info/" in name}
        assert {name: archive.read(f"{info}/licenses/{name}").decode() for name in TEXTS} == TEXTS
        _holds(archive.read(f"{info}/METADATA").decode())
        # Whoever installs the wheel has the pages, and its workers the report.
        assert set(PAGES) <= set(archive.namelist())


def test_the_source_archive_holds_it(built: Path) -> None:
    (source,) = built.glob("*.tar.gz")
    with tarfile.open(source) as archive:
        top = archive.getnames()[0].split("/")[0]
        files = {name: archive.extractfile(f"{top}/{name}") for name in (*TEXTS, "PKG-INFO")}
        texts = {name: file.read().decode() for name, file in files.items() if file}
    _holds(texts.pop("PKG-INFO"))
    assert texts == TEXTS


def test_the_image_and_the_pages_state_it() -> None:
    build, _, image = (ROOT / "Dockerfile").read_text().rpartition("\nFROM ")
    assert re.search(r'^LABEL .*org\.opencontainers\.image\.licenses="Apache-2\.0"', image, re.MULTILINE)
    assert re.search(r"^COPY LICENSE NOTICE \S+", image, re.MULTILINE)
    assert re.search(r"^COPY .*\bLICENSE NOTICE \./$", build, re.MULTILINE), "the wheel is built without it"
    assert json.loads((ROOT / "frontend" / "package.json").read_text())["license"] == "Apache-2.0"


def test_the_notice_names_every_package_that_is_installed_and_its_licence() -> None:
    """`python -m tests.support.notice > NOTICE` writes it anew."""
    assert TEXTS["NOTICE"] == notice()
