"""Where an export is written, and what stays if writing fails."""

from __future__ import annotations

import os

import pytest
import typer

from apexcal.commands.export import write_exported
from apexcal.resources.exports import ExportedFile


def test_a_file_that_cannot_be_replaced_keeps_what_it_held(tmp_path, monkeypatch):
    robot = tmp_path / "robot.urdf"
    robot.write_bytes(b"<robot/>" * 1000)
    robot.chmod(0o640)

    def full(descriptor):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(typer.Exit):
            write_exported(ExportedFile("robot.urdf", b"<robot>new</robot>"), robot, force=True)
    assert robot.read_bytes() == b"<robot/>" * 1000 and list(tmp_path.iterdir()) == [robot]
    write_exported(ExportedFile("robot.urdf", b"<robot>new</robot>"), robot, force=True)
    assert robot.read_bytes() == b"<robot>new</robot>" and robot.stat().st_mode & 0o777 == 0o640


def test_a_link_stays_a_link(tmp_path):
    robot, link = tmp_path / "robot.urdf", tmp_path / "link.urdf"
    robot.write_bytes(b"old")
    link.symlink_to(robot)
    write_exported(ExportedFile("link.urdf", b"new"), link, force=True)
    assert link.is_symlink() and robot.read_bytes() == b"new"
