"""`apexcal.fit`: arrays in, the worker's own result out, and nothing of the workers loaded before it is called."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import apexcal
from apexcal.documents.checks import verdict_of
from apexcal.documents.fit_requests import fit_request
from apexcal.errors import InputError
from tests.faults.jobs import SHORT
from workers.solver.narrowing import run_search
from workers.tasks.run_inputs import read_run
from workers.tasks.solving import solved

SIZE = (1280, 800)
K = np.array([[900.0, 0.0, 650.0], [0.0, 905.0, 410.0], [0.0, 0.0, 1.0]])
NAMED = {"f_x": 900, "f_y": 905, "c_x": 650, "c_y": 410, "k1": -0.21, "k2": 0.06, "k3": 1e-3, "k4": -5e-4}
D = np.array([-0.21, 0.06, 1e-3, -5e-4, 0.0])


@pytest.fixture(scope="module")
def truth():
    """(points (N, 3), pixels (N, 2), R, t) of cv2, with marks that are 0.3 px off."""
    random = np.random.default_rng(3)
    R = Rotation.from_euler("zyx", [-92.0, 4.0, -87.0], degrees=True).as_matrix()
    t = np.array([0.08, -0.12, 0.05])
    seen = random.uniform([-3.0, -1.8, 4.0], [3.0, 1.8, 12.0], (80, 3))
    pixels = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    is_inside = ((pixels >= 0) & (pixels <= np.array(SIZE) - 1)).all(axis=1)
    pixels += random.normal(0.0, 0.3, pixels.shape)
    return ((seen - t) @ R)[is_inside], pixels[is_inside], R, t


def test_arrays_in_and_the_mount_with_its_lens_out(truth):
    points, pixels, R, t = truth
    result = apexcal.fit(points, pixels, SIZE, schedule=SHORT)
    turn = Rotation.from_matrix(np.array(result.transform.rotation.matrix) @ R.T).magnitude()
    assert result.status == "ok" and result.checks
    assert np.degrees(turn) < 0.3
    assert np.linalg.norm(np.array(result.transform.translation_m) - t) < 0.05
    lines = str(result).splitlines()
    assert len(lines) == 5
    assert lines[0].startswith(f"brown_conrady: {verdict_of(result.checks, 'mount_with_lens')}; ")
    assert f"{result.transform.translation_m[0]:.4f}" in lines[1] and "f_x" in lines[2] and "px RMS" in lines[3]


@pytest.mark.parametrize("lens", [(K, D), NAMED])
def test_a_known_lens_is_locked_in_either_form(truth, lens):
    points, pixels, _, t = truth
    result = apexcal.fit(points, pixels, SIZE, lens=lens, schedule=SHORT)
    assert result.intrinsics.f_x == 900.0 and result.intrinsics.k1 == -0.21 and result.intrinsics.skew == 0.0
    assert np.linalg.norm(np.array(result.transform.translation_m) - t) < 0.02


def test_it_is_the_workers_own_result(truth):
    """To the bit: what a worker makes of the same request and pairs."""
    points, pixels, *_ = truth
    drawn = np.vstack([np.column_stack([truth[2], truth[3]]), [0, 0, 0, 1]])
    mine = apexcal.fit(points, pixels, SIZE, "pinhole", T_camera_lidar=drawn, seed=7, schedule=SHORT)
    columns = dict(zip("xyzuv", np.column_stack([points, pixels]).T.tolist(), strict=True))
    run = read_run(request_of(drawn), -1, columns)
    theirs = solved(run, run_search(run.problem))
    dumped = [each.model_dump(mode="json", exclude={"provenance", "checks"}) for each in (mine, theirs)]
    assert dumped[0] == dumped[1]


def request_of(drawn):
    mount = {"rotation": {"matrix": drawn[:3, :3].tolist()}, "translation_m": drawn[:3, 3].tolist()}
    nominal = {"to_frame": "camera", "from_frame": "lidar", **mount}
    return fit_request("pinhole", SIZE, nominal, seed=7, schedule=SHORT).model_dump(mode="json")


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"model": "fisheye"}, "not a model name"),
        ({"model": "pinhole", "lens": (K, D)}, "no K"),
        ({"lens": {"f": 900.0}}, "has no f"),
        ({"T_camera_lidar": np.eye(3)}, r"not \(4, 4\)"),
        ({"schedule": {"slots": 0}}, "."),
        ({"points": np.zeros((3, 3)), "pixels": np.zeros((3, 2))}, "3 pairs"),
        ({"points": np.zeros((3, 2)), "pixels": np.zeros((3, 2))}, "."),
    ],
)
def test_what_makes_no_fit_is_said(truth, changed, sentence):
    with pytest.raises(InputError, match=sentence):
        apexcal.fit(**{"points": truth[0], "pixels": truth[1], "image_size": SIZE} | changed)


def test_millimetres_and_a_turned_image_size_are_refused_by_name(truth):
    points, pixels, *_ = truth
    with pytest.raises(InputError, match="not in metres") as millimetres:
        apexcal.fit(1000.0 * points, pixels, SIZE)
    assert "millimetres" in millimetres.value.hint
    with pytest.raises(InputError, match="inside 1280 x 800") as turned:
        apexcal.fit(points, pixels, SIZE[::-1])
    assert "(width, height): (1280, 800)" in turned.value.hint
