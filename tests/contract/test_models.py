"""Service and workers mean the same by folds and transforms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apexcal.documents.transforms import Transform
from service.calibration_runs import transforms
from service.calibrations.fold_rules import fold_count
from workers.geometry import transforms as worker_transforms
from workers.geometry.transforms import RigidTransform
from workers.solver.folds import folds

column = st.one_of(
    st.lists(st.integers(0, 6), min_size=1, max_size=60).map(lambda groups: {"group": groups}),
    st.lists(st.integers(0, 10**18), min_size=1, max_size=60).map(lambda stamps: {"stamp_ns": stamps}),
    st.lists(st.sampled_from(["a", "b", "c", "dd"]), min_size=1, max_size=60).map(lambda groups: {"group": groups}),
    st.integers(1, 60).map(lambda _: {}),
)


@settings(max_examples=300, deadline=None)
@given(column, st.integers(1, 60), st.integers(2, 8), st.integers(1, 16))
def test_the_workers_can_cut_the_folds_that_the_service_counts(given_column, size, wanted, free):
    count = len(next(iter(given_column.values()))) if given_column else size
    pairs = {"x": [0.0] * count, **given_column}
    counts, sentences = fold_count(pairs, wanted, {"pinhole": free}, "front")
    number = counts["pinhole"]
    assert (not sentences) == (number == wanted)
    if not number:
        return
    values = pairs.get("group") or pairs.get("stamp_ns") or range(count)
    blocks = folds(values, number)
    assert len(blocks) == number
    assert all(count - len(block.indices) >= free for block in blocks)


angle = st.floats(-180, 180)
metres = st.floats(-50, 50)


def euler_document(to_frame, from_frame, angles, order, t):
    rotation = {"euler_order": order, "angles_deg": list(angles)}
    return {"to_frame": to_frame, "from_frame": from_frame, "rotation": rotation, "translation_m": list(t)}


@settings(max_examples=200, deadline=None)
@given(
    st.tuples(angle, angle, angle), st.tuples(angle, angle, angle), st.tuples(metres, metres, metres),
    st.sampled_from(["zyx", "xyz_eq2"]), st.sampled_from(["matrix", "quaternion_xyzw", "euler"]),
)  # fmt: skip
def test_the_composed_transform_is_the_one_of_the_geometry(first, second, t, order, written_as):
    vehicle_lidar = euler_document("base_link", "velodyne", first, order, t)
    camera_lidar = worker_transforms.to_document(
        worker_transforms.from_document(euler_document("camera", "velodyne", second, "zyx", t))
    )
    rotation = camera_lidar["rotation"]
    one_form = rotation["euler"][0] if written_as == "euler" else {written_as: rotation[written_as]}
    ours = transforms.T_vehicle_camera(vehicle_lidar, camera_lidar | {"rotation": one_form})
    expected: RigidTransform = (
        worker_transforms.from_document(vehicle_lidar) @ worker_transforms.from_document(camera_lidar).inverse()
    )
    assert (ours["to_frame"], ours["from_frame"]) == ("base_link", "camera")
    found = worker_transforms.from_document(ours)
    np.testing.assert_allclose(found.R, expected.R, atol=1e-9)
    np.testing.assert_allclose(found.t, expected.t, atol=1e-7)
    for form in (*ours["rotation"]["euler"], {"quaternion_xyzw": ours["rotation"]["quaternion_xyzw"]}):
        again = worker_transforms.from_document(ours | {"rotation": form})
        np.testing.assert_allclose(again.R, expected.R, atol=1e-7)


@pytest.mark.parametrize("beta", [-90.0, 90.0])
@pytest.mark.parametrize("order", ["zyx", "xyz_eq2"])
def test_angles_at_their_singular_point_still_give_the_rotation(beta, order):
    document = euler_document("base_link", "velodyne", (30.0, beta, -20.0), order, (0, 0, 0))
    identity = euler_document("camera", "velodyne", (0.0, 0.0, 0.0), "zyx", (0, 0, 0))
    found = transforms.T_vehicle_camera(document, identity)
    expected = worker_transforms.from_document(document).R
    for form in found["rotation"]["euler"]:
        again = worker_transforms.from_document(found | {"rotation": form})
        np.testing.assert_allclose(again.R, expected, atol=1e-9)


@pytest.mark.parametrize("angles", [(90.0, -105.0, 0.0), (90.0, -75.0, 3.0), (-20.0, 100.0, 10.0), (1.0, 2.0, 178.0)])
def test_of_two_triples_of_angles_both_name_the_same(angles):
    document = euler_document("base_link", "velodyne", angles, "zyx", (0, 0, 0))
    identity = euler_document("camera", "velodyne", (0.0, 0.0, 0.0), "zyx", (0, 0, 0))
    found = transforms.T_vehicle_camera(document, identity)["rotation"]["euler"]
    expected = worker_transforms.to_document(worker_transforms.from_document(document))["rotation"]["euler"]
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours["angles_deg"], theirs["angles_deg"], atol=1e-9)


def test_a_matrix_of_few_digits_is_made_a_rotation():
    rough = {"matrix": [[0.0001, -1.0, 0.0], [0.0, 0.0, -0.9999], [1.0, 0.0002, 0.0]]}
    document = {"to_frame": "a", "from_frame": "b", "rotation": rough, "translation_m": [1, 2, 3]}
    R, _ = transforms.read(document)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_a_transform_as_results_say_it_is_taken_as_a_mount():
    said = worker_transforms.to_document(
        worker_transforms.from_document(euler_document("camera", "velodyne", (90, -105, 0), "zyx", (0, 0, 0)))
    )
    assert list(Transform.model_validate(said).rotation.model_dump()) == ["matrix"]
