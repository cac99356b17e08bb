"""A rig from sensors, trees and answers: where mounts come from, what is asked, and what is refused."""

import numpy as np
import pytest

from apexcal.documents.errors import InputError
from apexcal.documents.rig_proposals import RigAnswers
from apexcal.geometry.frame_tree import urdf_tree
from apexcal.geometry.rig_proposal import RecordedSensor, propose_rig
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL
from apexcal.geometry.se3 import from_document

URDF = """<robot name="car">
  <link name="base_link"/><link name="velodyne"/><link name="camera_link"/><link name="camera_front_optical"/>
  <joint name="lidar_joint" type="fixed"><parent link="base_link"/><child link="velodyne"/>
    <origin xyz="1.2 0 1.9" rpy="0 0 0.05"/></joint>
  <joint name="camera_joint" type="fixed"><parent link="base_link"/><child link="camera_link"/>
    <origin xyz="1.5 0.1 1.4" rpy="0.01 0.02 0.03"/></joint>
  <joint name="optical_joint" type="fixed"><parent link="camera_link"/><child link="camera_front_optical"/>
    <origin xyz="0 0 0" rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint>
</robot>"""
LIDAR = RecordedSensor("lidar", "/velodyne_points", "velodyne")


def camera(frame_id="camera_front_optical", name="front", **more):
    return RecordedSensor(name, f"/{name}/image", frame_id, (640, 480), **more)


def proposed(*sensors, urdf=URDF, **answers):
    trees = {"the URDF": urdf_tree(urdf.encode())} if urdf else {}
    return propose_rig(sensors or (LIDAR, camera()), trees, RigAnswers.model_validate(answers))


def mount(proposal):
    return from_document(proposal.rig.cameras[0].nominal)


def test_a_tree_gives_mount_vehicle_and_joint():
    proposal = proposed()
    (front,) = proposal.rig.cameras
    T = urdf_tree(URDF.encode()).transform("camera_front_optical", "velodyne")
    np.testing.assert_allclose(mount(proposal).matrix, T.matrix, atol=1e-12)
    assert (proposal.rig.lidar.topic, front.topic, front.image_size) == (
        "/velodyne_points",
        "/front/image",
        (640, 480),
    )
    assert proposal.rig.T_vehicle_lidar.to_frame == "base_link"
    assert proposal.rig.T_vehicle_lidar.translation_m == pytest.approx((1.2, 0.0, 1.9))
    assert (front.joint.T_parent_lidar.to_frame, front.joint.T_child_camera.to_frame) == ("base_link", "camera_link")
    assert not proposal.questions and "as the URDF says" in proposal.notes[0] and "camera_link" in proposal.notes[0]
    other = proposed(joints={"front": "optical_joint"}).rig.cameras[0].joint
    assert other.T_parent_lidar.to_frame == "camera_link"


@pytest.mark.parametrize(
    ("looks", "axis"), [("forward", (1, 0, 0)), ("left", (0, 1, 0)), ("backward", (-1, 0, 0)), ("right", (0, -1, 0))]
)
def test_without_a_tree_a_person_says_where_a_camera_looks(looks, axis):
    asked = proposed(urdf=None)
    assert [(each.sensor, each.asks, each.assumed) for each in asked.questions] == [("front", "looks", "forward")]
    np.testing.assert_array_equal(mount(asked).R, FORWARD_LIDAR_TO_OPTICAL)
    answered = proposed(urdf=None, looks={"front": looks})
    assert not answered.questions and answered.rig.T_vehicle_lidar is None
    # The optical axis is z, down is y.
    np.testing.assert_array_equal(mount(answered).R[2], axis)
    np.testing.assert_array_equal(mount(answered).R[1], (0, 0, -1))


def test_what_a_person_says_goes_before_the_tree():
    proposal = proposed(looks={"front": "left"})
    # The LiDAR is turned by 0.05 rad; the vehicle's left is meant.
    np.testing.assert_allclose(mount(proposal).R[2], [np.sin(0.05), np.cos(0.05), 0.0], atol=1e-12)
    assert proposal.rig.cameras[0].joint is None


def test_a_frame_that_the_tree_lacks_is_asked_for_with_the_likeliest_first():
    proposal = proposed(RecordedSensor("lidar", "/points", "os_sensor"), camera("cam0"))
    lidar, front = proposal.questions
    assert (lidar.sensor, lidar.asks, lidar.assumed) == ("lidar", "frames", "velodyne")
    assert (front.sensor, front.assumed, front.choices[0]) == ("front", *["camera_front_optical"] * 2)
    assert "'cam0'" in front.sentence
    answered = proposed(
        RecordedSensor("lidar", "/points", "os_sensor"),
        camera("cam0"),
        frames={"lidar": "velodyne", "front": "camera_front_optical"},
    )
    assert not answered.questions
    np.testing.assert_allclose(mount(answered).matrix, mount(proposed()).matrix, atol=1e-12)
    # A frame that is in no tree is a name, and then nothing says where the camera is.
    nowhere = proposed(LIDAR, camera("cam0"), frames={"front": "mast"})
    assert [(each.asks, each.sensor) for each in nowhere.questions] == [("looks", "front")]


def test_two_cameras_of_which_neither_is_likelier_are_both_asked_for():
    second = URDF.replace("</robot>", "").replace('"camera_front_optical"', '"camera_a_optical"') + (
        '<joint name="b" type="fixed"><parent link="base_link"/><child link="camera_b_optical"/></joint></robot>'
    )
    proposal = proposed(LIDAR, camera("c0", "left"), camera("c1", "right"), urdf=second)
    assert [(each.sensor, each.assumed) for each in proposal.questions] == [("left", "c0"), ("right", "c1")]


def test_images_stamped_with_the_cameras_body_get_its_optical_frame():
    """A body looks along x. Its optical frame stands below it in the tree, or is made."""
    optical = proposed(LIDAR, camera("camera_link"))
    assert optical.rig.cameras[0].frame == "camera_front_optical"
    np.testing.assert_allclose(mount(optical).matrix, mount(proposed()).matrix, atol=1e-12)
    begin, end = URDF.index('  <joint name="optical_joint"'), URDF.index("</robot>")
    bare = URDF[:begin].replace('<link name="camera_front_optical"/>', "") + URDF[end:]
    made = proposed(LIDAR, camera("camera_link"), urdf=bare)
    (front,) = made.rig.cameras
    assert front.frame == "camera_link_optical" and front.joint.T_child_camera.to_frame == "camera_link"
    np.testing.assert_allclose(mount(made).matrix, mount(proposed()).matrix, atol=1e-6)


def tree(*joints):
    """A URDF of joints (parent, child, rpy, type); the LiDAR is velodyne, 1 m above."""
    text = "".join(
        f'<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 1" rpy="{rpy}"/></joint>'
        for parent, child, rpy, kind in ((*joint, "fixed")[:4] for joint in joints)
    )
    return f'<robot name="car">{text}</robot>'


BODY, TURNED = "0 0 0", f"{-np.pi / 2} 0 {-np.pi / 2}"
# What a URDF says, and where in the vehicle's axes the camera then looks and where its image's top is.
FORWARD, UP = (1, 0, 0), (0, 0, 1)
LEANING = {
    "a LiDAR that hangs upside down, and the camera's body": ("0 2.9 0", BODY, FORWARD, UP),
    "a LiDAR that is rolled over": (f"{np.pi} 0 0", BODY, FORWARD, UP),
    "a LiDAR on its side": (f"{np.pi / 2} 0 0", BODY, FORWARD, UP),
    "an optical frame without the word": (f"{np.pi} 0 0", TURNED, FORWARD, UP),
    "a tilted LiDAR, and an optical frame": ("0 0.8 0", TURNED, FORWARD, UP),
    "a body that leans down by 40 degrees": (
        "0 2.9 0",
        f"0 {np.radians(40)} 0",
        (np.cos(np.radians(40)), 0, -np.sin(np.radians(40))),
        None,
    ),
    "a body that looks left": (f"{np.pi} 0 0.3", f"0 0 {np.pi / 2}", (0, 1, 0), UP),
}


@pytest.mark.parametrize("case", LEANING)
def test_a_bodys_frame_is_told_in_the_trees_own_up(case):
    lidar_rpy, camera_rpy, ahead, top = LEANING[case]
    urdf = tree(("base_link", "velodyne", lidar_rpy), ("base_link", "front_camera", camera_rpy))
    proposal = proposed(LIDAR, camera("front_camera"), urdf=urdf)
    R = mount(proposal).R @ urdf_tree(urdf.encode()).transform("velodyne", "base_link").R
    np.testing.assert_allclose(R[2], ahead, atol=1e-12)
    if top is not None:
        np.testing.assert_allclose(-R[1], top, atol=1e-12)
    assert not proposal.questions and f"{90 if case.endswith('left') else 0} degrees" in proposal.notes[0]


@pytest.mark.parametrize(
    ("joints", "says"),
    [
        # Named optical, but turned as a body.
        ([("base_link", "velodyne", BODY), ("base_link", "front_optical", BODY)], "90 up in base_link"),
        ([("base_link", "velodyne", BODY), ("base_link", "front_optical", "0 2.88 0")], "75 down in base_link"),
        ([("base_link", "velodyne", BODY), ("base_link", "front_optical", f"0 0 {np.pi}")], "90 up in base_link"),
        (
            [("base_link", "velodyne", BODY), ("base_link", "front_optical", f"{-np.pi / 2} 0 {np.pi / 2}")],
            "180 degrees",
        ),
        ([("base_link", "velodyne", f"{np.pi} 0 0"), ("base_link", "front_optical", BODY)], "90 up in base_link"),
        # Without a vehicle's frame the LiDAR's own up counts.
        ([("velodyne", "front_optical", f"{np.pi} 0 0")], "90 down in velodyne"),
        (
            [("earth", "map", "0.8 0 0"), ("map", "velodyne", BODY), ("velodyne", "front_optical", BODY)],
            "90 up in velodyne",
        ),
        ([("front_optical", "velodyne", f"0 {np.pi / 2} {np.pi}")], "180 degrees left, 0 up in velodyne"),
    ],
)
def test_a_mount_that_looks_straight_up_or_down_or_backwards_is_asked_about(joints, says):
    sensors = LIDAR, camera("front_optical")
    (question,) = proposed(*sensors, urdf=tree(*joints)).questions
    assert (question.asks, question.assumed, question.choices[0]) == ("looks", "tree", "tree")
    assert says in question.sentence and "axes may be exchanged" in question.sentence
    # Confirmed or answered, it is asked no more.
    confirmed = proposed(*sensors, urdf=tree(*joints), looks={"front": "tree"})
    assert not confirmed.questions
    np.testing.assert_array_equal(mount(confirmed).matrix, mount(proposed(*sensors, urdf=tree(*joints))).matrix)
    assert not proposed(*sensors, urdf=tree(*joints), looks={"front": "forward"}).questions


def test_a_rear_camera_may_look_backwards_and_an_answer_is_of_the_vehicle():
    backwards = f"{-np.pi / 2} 0 {np.pi / 2}"
    joints = ("base_link", "velodyne", "0 2.9 0"), ("base_link", "optical_frame", backwards)
    rear = proposed(LIDAR, camera("optical_frame", "rear"), urdf=tree(*joints))
    assert not rear.questions
    (contrary,) = proposed(
        LIDAR, camera("optical_frame", "rear"), urdf=tree(joints[0], (*joints[1][:2], TURNED))
    ).questions
    assert contrary.sensor == "rear"
    answered = proposed(LIDAR, camera("optical_frame"), urdf=tree(*joints), looks={"front": "forward"})
    R = mount(answered).R @ urdf_tree(tree(*joints).encode()).transform("velodyne", "base_link").R
    np.testing.assert_allclose(R, FORWARD_LIDAR_TO_OPTICAL, atol=1e-12)


def test_a_head_that_turns_has_its_own_up():
    joints = [
        ("base_link", "head", f"{np.pi / 2} 0 0", "revolute"), ("head", "velodyne", "0 2.9 0"), ("head", "eye", BODY),
    ]  # fmt: skip
    R = mount(proposed(LIDAR, camera("eye"), urdf=tree(*joints))).R
    np.testing.assert_allclose(
        R @ urdf_tree(tree(*joints).encode()).transform("velodyne", "head").R, FORWARD_LIDAR_TO_OPTICAL, atol=1e-12
    )


def test_confirming_a_tree_that_does_not_lead_there_answers_nothing():
    (question,) = proposed(urdf=None, looks={"front": "tree"}).questions
    assert question.asks == "looks" and question.assumed == "forward"


@pytest.mark.parametrize(
    ("sensors", "frames"),
    [
        ((RecordedSensor("lidar", "clouds", ""), camera("")), ["lidar", "camera_front_optical"]),
        ((RecordedSensor("lidar", "/p", "/map"), camera("map")), ["map", "camera_front_optical"]),
        ((LIDAR, camera("a"), camera("a", "rear")), ["velodyne", "a", "camera_rear_optical"]),
        ((LIDAR, camera("a\u202eb")), ["velodyne", "camera_front_optical"]),
        ((LIDAR, camera("x" * 300)), ["velodyne", "camera_front_optical"]),
    ],
)
def test_a_frame_that_is_no_name_or_another_sensors_is_replaced(sensors, frames):
    rig = proposed(*sensors, urdf=None).rig
    assert [rig.lidar.frame, *(each.frame for each in rig.cameras)] == frames


def test_rectified_images_keep_the_turn_of_their_camera_info():
    R = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    rectified = proposed(LIDAR, camera(image_kind="rectified", R=R)).rig.cameras[0].images
    assert rectified.kind == "rectified" and rectified.rotation.matrix[0] == (0.0, -1.0, 0.0)
    raw = proposed(LIDAR, camera(image_kind="raw", R=R)).rig.cameras[0].images
    assert raw.kind == "raw" and raw.rotation is None
    assert proposed(LIDAR, camera()).rig.cameras[0].images is None


@pytest.mark.parametrize("joint", ["camera_joint", "lidar_joint"])
def test_a_moving_joint_is_named_and_the_mount_asked_for(joint):
    moving = URDF.replace(f'name="{joint}" type="fixed"', f'name="{joint}" type="revolute"')
    (question,) = proposed(urdf=moving).questions
    assert question.asks == "looks" and repr(joint) in question.sentence


def test_trees_that_do_not_hang_together_are_said_to():
    apart = URDF.replace('<parent link="base_link"/><child link="camera_link"/>', '<child link="camera_link"/>')
    assert proposed(urdf=apart).questions[0].asks == "looks"


@pytest.mark.parametrize(
    ("answers", "says"),
    [
        ({"frames": {"rear": "x"}}, "no 'rear'"),
        ({"looks": {"lidar": "left"}}, "no 'lidar'"),
        ({"joints": {"front": "lidar_joint"}}, "not on the camera's side"),
    ],
)
def test_an_answer_that_cannot_be_is_refused(answers, says):
    with pytest.raises(InputError) as refused:
        proposed(**answers)
    assert refused.value.code == "frames_not_usable" and says in refused.value.message and refused.value.hint


def test_a_frame_with_two_parents_and_a_circle_are_refused():
    def with_joint(parent, child):
        text = f'<joint name="x" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint></robot>'
        return proposed(urdf=URDF.replace("</robot>", text))

    with pytest.raises(InputError, match="two parents"):
        with_joint("velodyne", "camera_link")
    with pytest.raises(InputError, match="own ancestor"):
        with_joint("camera_front_optical", "base_link")
