"""A process that reads uploads, as seen from inside: what it may still reach."""

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.places import ROOT
from workers.readers.isolation.isolate import Isolation
from workers.readers.limited import isolation_here

PROBE = Path(__file__).with_name("probe.py")
REFUSED = {"EACCES", "EPERM", "ENOENT", "ENETUNREACH", "ESRCH", "ENOSYS"}
NEEDED = ("source read", "own folder", "python")
NAMESPACES = ["unshare", "setns"]
LANDLOCK = ["landlock_create_ruleset"]


@pytest.fixture
def house(tmp_path):
    """A service's folder: a database, a broker's socket, a listening port, and an upload being read."""
    # Where another user can reach it: pytest's own folders are this user's alone.
    folder = Path("/tmp") / f"apexcal-isolation-{os.getpid()}"
    folder.mkdir()
    (folder / "database.db").write_bytes(b"secret")
    (folder / "upload.bag").write_bytes(b"uploaded")
    (folder / "out").mkdir()
    with contextlib.ExitStack() as open_:
        tcp = open_.enter_context(socket.create_server(("127.0.0.1", 0)))
        broker = open_.enter_context(contextlib.closing(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)))
        broker.bind(str(folder / "broker.sock"))
        broker.listen()
        yield {
            "parent": os.getpid(),
            "port": tcp.getsockname()[1],
            "broker": str(folder / "broker.sock"),
            "database": str(folder / "database.db"),
            "source": str(folder / "upload.bag"),
            "out": str(folder / "out"),
            "refused": [],
        }
    shutil.rmtree(folder)


def probe(case, python=sys.executable, user=None):
    """What the probe got; as another user everything in the house is that user's."""
    identity = {}
    if user is not None:
        for path in (Path(case["out"]).parent, *Path(case["out"]).parent.iterdir()):
            os.chown(path, user, user)
        identity = {"user": user, "group": user, "extra_groups": []}
    # Its starter is the user's too, as a worker is.
    waiting = subprocess.Popen(["/bin/sleep", "60"], env={"SECRET": "password"}, **identity)
    try:
        command = [python, str(PROBE), json.dumps(case | {"parent": waiting.pid})]
        environment = {"PYTHONPATH": str(ROOT), "PATH": os.environ["PATH"], "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, **identity)
    finally:
        waiting.kill()
        waiting.wait()
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    return Isolation(**said.pop("isolation")), said


def check(in_force, got):
    """Everything is refused that the means in force are there to refuse, and reading works."""
    assert all(isinstance(got[name], int) for name in NEEDED), got
    closed = set()
    if in_force.landlock:
        closed |= {"environ", "memory", "ptrace", "database", "outside", "source written", "root"}
    if in_force.landlock >= 4 or in_force.namespaces:
        closed |= {"tcp"}
    if in_force.seccomp:
        closed |= {"tcp", "broker", "ptrace", "signal", "program", "process"}
    assert {name for name in closed if got[name] not in REFUSED} == set(), (in_force, got)


def users():
    """This user, and where this one is root the one of our containers."""
    return [None, 1000] if os.getuid() == 0 else [None]


def python_of(user):
    """A Python that this user may start: the one that runs this test may lie in a folder of root's."""
    for python in (sys.executable, "/usr/bin/python3"):
        with contextlib.suppress(OSError):
            if subprocess.run([python, "-c", ""], user=user, group=user, check=False).returncode == 0:
                return python
    pytest.skip("no Python that another user may start")


@pytest.mark.parametrize("user", users())
@pytest.mark.parametrize("missing", ["nothing", "namespaces", "landlock", "both"])
def test_the_rest_of_the_machine_is_out_of_reach(house, user, missing):
    python = python_of(user)
    refused = {"namespaces": NAMESPACES, "landlock": LANDLOCK, "both": NAMESPACES + LANDLOCK}.get(missing, [])
    if refused and not isolation_here().seccomp:
        pytest.skip("without libseccomp the kernel cannot be made to refuse")
    in_force, got = probe(house | {"refused": refused}, python, user)
    if not (in_force.landlock or in_force.seccomp):
        pytest.skip(f"this kernel isolates nothing: {in_force}")
    if refused:
        assert (in_force.namespaces, bool(in_force.landlock)) == (
            isolation_here().namespaces and missing == "landlock",
            bool(isolation_here().landlock) and missing == "namespaces",
        )
    check(in_force, got)


@pytest.mark.parametrize("hides", [False, True])
def test_a_program_that_hides_cannot_be_read_by_others_of_its_user(hides):
    user = 1000 if os.getuid() == 0 else None
    identity = {"user": user, "group": user}
    code = "from workers.readers.isolation.isolate import hide_from_others as hide\n" + "hide()\n" * hides
    code += "print(flush=True); input()"
    environment = {"PYTHONPATH": str(ROOT), "SECRET": "password"}
    with subprocess.Popen(
        [python_of(user), "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, **identity
    ) as process:
        process.stdout.readline()
        other = subprocess.run(
            ["/bin/cat", f"/proc/{process.pid}/environ"], capture_output=True, check=False, **identity
        )
        process.communicate(b"\n")
    assert (b"password" in other.stdout, b"denied" in other.stderr) == (not hides, hides)


def test_what_is_in_force_is_said_in_words():
    here = isolation_here()
    assert "Landlock" in str(here) and "seccomp" in str(here) and "network" in str(here)
    bare = str(Isolation(False, False, 0, False))
    assert "no Landlock" in bare and "no seccomp" in bare and "no network namespace" in bare
