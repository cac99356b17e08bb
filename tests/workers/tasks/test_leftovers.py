"""A dead process's scratch goes, and nobody else's."""

from __future__ import annotations

import os
import socket
import subprocess
import sys

import pytest

from workers.tasks.context import Context, remove_leftovers, scratch_prefix


@pytest.fixture
def dead() -> int:
    """The id of a process that has ended."""
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


@pytest.mark.parametrize(("host", "other"), [("gpu", "gpu-7"), ("gpu", "gpu.lab"), ("gpu+7", "gpu"), ("a/b", "a")])
def test_a_host_sweeps_its_own_dead_and_no_other_hosts(tmp_path, monkeypatch, dead, host, other):
    def named(name: str, pid: int) -> str:
        monkeypatch.setattr(socket, "gethostname", lambda: name)
        monkeypatch.setattr(os, "getpid", lambda: pid)
        return f"{scratch_prefix()}x"

    # Of another host as many as its process ids may look like: the living there are the dead here.
    others = [named(other, pid) for pid in (dead, 7, 1)]
    mine, alive = named(host, dead), named(host, os.getppid())
    for name in (*others, mine, alive):
        (tmp_path / name).mkdir()
    remove_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*others, alive])


def test_a_scratch_folder_is_left_alone_while_its_process_lives(settings):
    with Context(settings).scratch() as folder:
        remove_leftovers(settings.scratch)
        assert folder.is_dir()
    assert not folder.exists()
