"""What a test draws follows from its id and a number, and from nothing else; no other process draws the same."""

import os
import secrets
import subprocess
import sys
from pathlib import Path
from random import SystemRandom
from uuid import uuid4
from xml.etree import ElementTree

import pytest

from tests.support.draws import DRAWS

_ROOT = Path(__file__).parents[2]
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
    command = f"-q -p tests.support.draws -p no:cacheprovider -c {_ROOT}/pyproject.toml --rootdir=. --draws {draws}"
    command += " -o junit_family=xunit1 --junitxml=drawn.xml"
    environment = os.environ | {"PYTHONPATH": str(_ROOT), "PYTHONHASHSEED": hash_seed}
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


def some_secret() -> str:
    return secrets.token_hex(8)


def test_a_place_draws_the_same_whatever_others_draw() -> None:
    with DRAWS.of_test("a test", 7):
        alone = [some_secret() for _ in range(3)]
    with DRAWS.of_test("a test", 7):
        beside = []
        for count in range(3):
            beside.append(some_secret())
            _ = [uuid4() for _ in range(count)]
    assert beside == alone
    with DRAWS.of_test("a test", 8):
        assert [some_secret() for _ in range(3)] != alone


def test_a_forked_child_draws_for_itself(tmp_path: Path) -> None:
    with DRAWS.of_test("a parent", 1):
        pid = os.fork()
        if not pid:
            (tmp_path / "child").write_text(f"{uuid4()} {SystemRandom().random()}")
            os._exit(0)
        os.waitpid(pid, 0)
        own = {str(uuid4()), str(SystemRandom().random())}
    assert own.isdisjoint((tmp_path / "child").read_text().split())
