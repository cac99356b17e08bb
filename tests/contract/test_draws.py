"""What a test draws follows from its id and a number, and from nothing else; no other process draws the same."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.support.places import ROOT

_TESTS = """
from random import SystemRandom
from uuid import uuid4

import pytest

from service.platform.auth.credential_actions import new_secret
from service.platform.db.base import new_id


@pytest.fixture(scope="session")
def shared():
    return [new_id().int & 2**62 - 1 for _ in range(3)]


@pytest.mark.parametrize("case", "ab")
def test_draws(case, shared, record_property, numbered_ids):
    record_property("drawn", f"{shared} {[new_id(), uuid4(), new_id()]} {new_secret()} {SystemRandom().random()}")


def test_fails(numbered_ids):
    assert not new_id()
"""


def drawn(draws: str, *more: str, hash_seed: str = "random") -> tuple[set[str], str]:
    """Run these tests in a process of their own: what they drew, and what was printed."""
    command = f"-q -p tests.support.draws -p no:cacheprovider -c {ROOT}/pyproject.toml --rootdir=. --draws {draws}"
    command += " -o junit_family=xunit1 --junitxml=drawn.xml"
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": hash_seed}
    printed = subprocess.run(
        [sys.executable, "-m", "pytest", *command.split(), *more], env=environment, capture_output=True, text=True
    ).stdout
    return {found.attrib["value"] for found in ElementTree.parse("drawn.xml").iter("property")}, printed


@pytest.fixture
def _tests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "test_it.py").write_text(_TESTS)
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("_tests")
def test_a_test_draws_the_same_in_any_order_and_process_and_says_how_to_draw_it_again() -> None:
    tests = [f"test_it.py::test_{name}" for name in ("draws[a]", "draws[b]", "fails")]
    once, printed = drawn("5", *tests)
    assert len(once) == 2, "each test has its own"
    assert "pytest --draws 5" in printed.partition("- draws -")[2]
    assert drawn("5", *reversed(tests), hash_seed="7")[0] == once
    several, printed = drawn("5-6", "test_it.py")
    assert len(several) == 4 and several > once and "pytest --draws 6" in printed
