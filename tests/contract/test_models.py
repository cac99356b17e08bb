"""Service and workers speak of models, parameters, presets, schedules, folds and transforms in the same words."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from apexcal.commands import choices
from service.calibrations import known_lens, lock_rules, model_names, transforms
from service.calibrations.fold_rules import fold_count
from service.calibrations.schemas import CalibrationRequest, ScheduleOverrides
from service.db.fleets import RigCamera
from service.detections.detectors import DETECTORS
from service.fleets.transforms import Transform
from service.http.problems import Problem
from workers.geometry import models as worker_models
from workers.geometry import transforms as worker_transforms
from workers.geometry.errors import GeometryError
from workers.geometry.transforms import RigidTransform
from workers.readers.recording import LidarModel
from workers.readers.ros import camera_info
from workers.solver import bounds as worker_bounds
from workers.solver import presets as worker_presets
from workers.solver import problem as worker_problem
from workers.solver.errors import SolveError
from workers.solver.folds import folds


def test_models_and_parameters_have_the_same_names_in_the_same_order():
    assert model_names.MODELS == worker_models.MODELS
    assert model_names.INTRINSICS == worker_models.INTRINSICS
    assert model_names.EXTRINSICS == worker_models.EXTRINSICS
    assert model_names.ANGLES == worker_problem.ANGLES
    for model in worker_models.MODELS:
        for form in worker_models.SEARCH_FORMS:
            assert model_names.parameter_names(model, form) == worker_models.parameter_names(model, form)


def test_lenses_are_read_by_the_same_names():
    assert known_lens.MODEL_OF == camera_info.MODELS
    assert known_lens.COEFFICIENTS == camera_info.COEFFICIENTS


def test_choices_are_the_same():
    assert get_args(model_names.SearchForm) == worker_models.SEARCH_FORMS
    assert get_args(model_names.BoundsPreset) == worker_bounds.BOUNDS_PRESETS
    assert get_args(model_names.Loss) == worker_problem.LOSSES
    assert get_args(model_names.OutlierRule) == get_args(worker_problem.OutlierRule)
    assert get_args(model_names.WeightRule) == ("auto", *get_args(worker_problem.WeightRule))
    assert get_args(model_names.PresetName) == get_args(worker_presets.PresetName)
    default = CalibrationRequest(correspondence_set_ids=["00000000-0000-7000-8000-000000000000"])
    assert default.outliers == worker_problem.FitProblem.__dataclass_fields__["outliers"].default
    assert default.rotation_range_deg == worker_bounds.DEFAULT_ROTATION_RANGE_DEG


def test_presets_have_the_same_size():
    theirs = {
        name: model_names.PresetSize(
            schedule.slots, schedule.population, schedule.generations, schedule.max_iterations
        )
        for name, schedule in worker_presets.PRESETS.items()
    }
    assert theirs == model_names.PRESETS


@pytest.mark.parametrize("name", ["fisheye", "Pinhole", "", "ocam"])
def test_both_refuse_the_same_model_names_and_name_the_others(name):
    with pytest.raises(Problem) as ours:
        model_names.check_model(name)
    with pytest.raises(GeometryError) as theirs:
        worker_models.parse_model(name)
    for known in ("kannala_brandt", "brown_conrady"):
        assert known in ours.value.hint and known in theirs.value.hint


LIMITS = {
    "slots": [0, 1, 1000, 1001],
    "population": [63, 64, 100_000, 100_001],
    "generations": [0, 1, 10_000, 10_001],
    "scale": [0.0, 0.01, 1.0, 1.01],
    "max_iterations": [0, 1, 1000, 1001],
    "patience": [0, 1, 1000],
    "tolerance": [-0.1, 0.0, 0.5, 1.0],
    "goal_px": [0.0, 0.1],
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in LIMITS.items() for value in values])
def test_schedules_have_the_same_limits(name, value):
    assert set(LIMITS) == set(ScheduleOverrides.model_fields)
    try:
        taken = bool(ScheduleOverrides.model_validate({name: value}))
    except ValidationError:
        taken = False
    try:
        theirs = bool(worker_presets.schedule_of("default", {name: value}))
    except SolveError:
        theirs = False
    assert taken == theirs


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
    number, sentence = fold_count(pairs, wanted, free, "pinhole on front")
    assert (sentence is None) == (number == wanted)
    if not number:
        return
    values = pairs.get("group") or pairs.get("stamp_ns") or range(count)
    blocks = folds(values, number)
    assert len(blocks) == number
    assert all(count - len(block) >= free for block in blocks)


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


def test_the_command_knows_the_same_words():
    assert choices.MODELS == get_args(choices.Model) == model_names.MODELS
    for theirs, ours in (
        (model_names.PresetName, choices.Preset),
        (model_names.SearchForm, choices.Search),
        (model_names.BoundsPreset, choices.Bounds),
        (model_names.Loss, choices.Loss),
        (model_names.WeightRule, choices.Weights),
        (model_names.OutlierRule, choices.Outliers),
        (known_lens.UseAs, choices.LensUse),
        (CalibrationRequest.model_fields["farm"].annotation, choices.Farm),
    ):
        assert get_args(theirs) == get_args(ours)
    assert set(get_args(choices.Detector)) == set(DETECTORS)
    assert set(get_args(choices.LidarModel)) == set(get_args(LidarModel))


def test_locks_are_held_against_the_bounds_that_the_search_has():
    nominal = RigidTransform("c", "l", np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0.3, -2.0, 0.0]))
    camera = RigCamera(image_width=1280, image_height=720, nominal=worker_transforms.to_document(nominal))
    for preset in worker_bounds.BOUNDS_PRESETS:
        for form in worker_models.SEARCH_FORMS:
            ours = lock_rules.preset_bounds(preset, form, camera, 12.5)
            for model in worker_models.MODELS:
                theirs = worker_bounds.preset_bounds(preset, model, form, (1280, 720), nominal, 12.5)
                for name, interval in theirs.items():
                    if (preset, form) == ("image-size", "euler") and name in ("alpha", "beta", "gamma"):
                        assert ours[name] == (-np.pi, np.pi)
                    else:
                        assert ours[name] == pytest.approx(interval, abs=1e-12), (preset, form, name)
