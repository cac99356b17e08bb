"""A vehicle's own URDF: the one joint as calibrated, every other byte as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.errors import InputError
from apexcal.geometry.se3 import SE3
from service.exports.urdf_patch import patched
from tests.service.exports.readers import _tree, joints
from tests.service.exports.rigs import mount

ORIGIN = '<origin rpy="0 0 0"\r\n      xyz="1 2 3" >  </origin>'
FILE = f"""<?xml version='1.0' encoding="utf-8"?>
<!-- ours: <joint name="mast_joint"> äöü -->
<robot name="truck">
  <link name="base_link"/><link name="roof"/> <link name="velodyne"/>
\t<link name="mast"/><link name="camera">
    <visual><origin xyz="9 9 9"/><geometry><box size="1 1 1"/></geometry></visual></link>
  <link name="camera_optical"/>
  <joint name="roof_joint" type="fixed"><parent link="base_link"/>
    <child link="roof"/><origin xyz="1.2 0 1.9" rpy="0.01 -0.02 0.3"/></joint>
  <joint name="lidar_joint" type="fixed"><parent link="roof"/>
    <child link="velodyne"/><origin xyz="0 0 .1" rpy="0 0 1.5"/></joint>\r
  <joint name="mast_joint" type="fixed">
    <parent link="base_link"/>
    <child link="mast"/>
    {ORIGIN}
  </joint>
  <joint name='camera > joint' type="fixed"><parent link="mast"/><child link="camera"/></joint>
  <joint name="optical_joint" type="fixed"><parent link="camera"/>
    <child link="camera_optical"/><origin rpy="-1.5707963 0 -1.5707963"/></joint>
  <joint name="wheel" type="continuous"><parent link="base_link"/><child link="wheel_link"/></joint>
  <link name="wheel_link"/>
  <transmission name="t"><type>x</type><joint name="wheel"><hardwareInterface>y</hardwareInterface></joint>
    <actuator name="a"/></transmission>
</robot>
""".encode()
MAST = b'<parent link="base_link"/>\n    <child link="mast"/>'
TWIN = b'<joint name="twin" type="fixed"><parent link="base_link"/><child link="mast"/></joint></robot>'
T = replace(mount(0, 0), to_frame="camera_optical", from_frame="velodyne")


def T_camera_lidar(document: bytes) -> np.ndarray:
    return _tree({edge: pose for edge, pose in joints(document).items() if edge[1] != "wheel_link"}, "camera_optical")


def fixed(document: bytes) -> bytes:
    """For the reader that asks every joint to be fixed."""
    return document.replace(b'type="continuous"', b'type="fixed"')


@pytest.mark.parametrize("number", [0, 1, 2])
@pytest.mark.parametrize("rig", [0, 1])
@pytest.mark.parametrize("joint", ["roof_joint", "lidar_joint", "mast_joint", "camera > joint", "optical_joint"])
def test_any_joint_between_the_two_may_be_the_one(joint, rig, number):
    wanted = replace(mount(number, rig), to_frame="camera_optical", from_frame="velodyne")
    new = patched(FILE, joint, wanted)
    assert np.abs(T_camera_lidar(fixed(new)) - wanted.matrix).max() < 1e-9
    before, after = joints(fixed(FILE)), joints(fixed(new))
    changed = [edge for edge in before if not np.array_equal(before[edge], after[edge])]
    assert len(changed) == 1


def test_every_other_byte_stays():
    head, tail = FILE.split(ORIGIN.encode())
    new = patched(FILE, "mast_joint", T)
    assert new.startswith(head + b"<origin xyz=") and new.endswith(b"/>" + tail)
    assert new.count(b"<origin") == FILE.count(b"<origin")
    # An origin that was left out is put in, right behind the joint's own tag.
    new = patched(FILE, "camera > joint", T)
    head, tail = FILE.split(b"""<joint name='camera > joint' type="fixed">""")
    assert new.startswith(head) and new.endswith(tail) and new.count(b"<origin") == FILE.count(b"<origin") + 1
    # As a program makes it: an element without content, and the next tag right behind it.
    new = patched(FILE, "roof_joint", T)
    head, tail = FILE.split(b'<origin xyz="1.2 0 1.9" rpy="0.01 -0.02 0.3"/>')
    assert new.startswith(head) and new.endswith(tail)


def test_a_file_with_a_byte_order_mark_and_windows_lines():
    document = b"\xef\xbb\xbf" + FILE.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")
    new = patched(document, "lidar_joint", T)
    head, tail = document.split(b'<origin xyz="0 0 .1" rpy="0 0 1.5"/>')
    assert new.startswith(head) and new.endswith(tail)


@pytest.mark.parametrize(
    ("document", "joint", "said"),
    [
        (FILE, "nobody", "The joints are roof_joint, lidar_joint"),
        (FILE, "wheel", "is continuous"),
        (FILE.replace(b'name="velodyne"', b'name="v"').replace(b'"velodyne"', b'"v"'), "mast_joint", "'velodyne'"),
        (FILE.replace(b'"roof_joint" type="fixed"', b'"roof_joint" type="revolute"'), "mast_joint", "'velodyne'"),
        (FILE.replace(b"lidar_joint", b"mast_joint"), "mast_joint", "Two joints"),
        (FILE.replace(b"1.2 0 1.9", b"1.2 0 x"), "mast_joint", "'1.2 0 x'"),
        (FILE.replace(b"1.2 0 1.9", b"1.2 0 nan"), "mast_joint", "nan"),
        (FILE.replace(b"1.2 0 1.9", b"${roof}"), "mast_joint", "xacro"),
        (FILE.replace(b"<transmission", b"<xacro:if value='1'/><transmission"), "mast_joint", "xacro"),
        (FILE.replace(b"utf-8", b"utf-16"), "mast_joint", "UTF-8"),
        (FILE.replace(b"</robot>", b""), "mast_joint", "no XML"),
        (b"<sdf/>", "mast_joint", "no <robot>"),
        (b"", "mast_joint", "no XML"),
        (
            b'<!DOCTYPE r [<!ENTITY a "b"><!ENTITY c "&a;&a;">]><robot name="x"><link name="&c;"/></robot>',
            "mast_joint",
            "document type",
        ),
        (b'<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot/>', "mast_joint", "document type"),
        (FILE.replace(MAST, b'<parent link="roof"/>\n    <child link="mast"/>'), "roof_joint", "moves both"),
        # Which of two between the same links a program reads is its own choice.
        (FILE.replace(b"</robot>", TWIN), "mast_joint", "'twin'"),
        # Products of such numbers are infinite, or none.
        *((FILE.replace(b"1.2 0 1.9", number + b" 0 1.9"), "mast_joint", "roof_joint")
          for number in (b"1e308", b"-1e7", b"nan", b"inf")),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused(document, joint, said):
    assert document != FILE or joint in ("nobody", "wheel")
    with pytest.raises(InputError) as found:
        patched(document, joint, T)
    assert found.value.code == "urdf_not_read"
    assert said in found.value.message + found.value.hint


def test_a_loop_of_joints_ends():
    document = FILE.replace(
        b"</robot>", b'<joint name="loop" type="fixed"><parent link="camera"/><child link="mast"/></joint></robot>'
    )
    assert patched(document, "lidar_joint", T) != document


def test_frames_may_have_other_names_than_links():
    other = SE3("front_optical", "top_lidar", T.R, T.t)
    with pytest.raises(InputError, match="front_optical"):
        patched(FILE, "mast_joint", other)


@pytest.mark.parametrize("encoding", ["UTF8", "utf8", "US-ASCII"])
def test_utf_8_by_any_of_its_names(encoding):
    named = FILE.replace(b"utf-8", encoding.encode())
    assert patched(named, "mast_joint", T) == patched(FILE, "mast_joint", T).replace(b"utf-8", encoding.encode())
    with_mark = b"\xef\xbb\xbf" + named
    assert patched(with_mark, "mast_joint", T).startswith(b"\xef\xbb\xbf<?xml")
