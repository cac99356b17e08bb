"""The mount under a stated lens, as another program projects with it, and lenses that the pairs deny."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from apexcal.documents.fit_requests import fit_request
from apexcal.documents.results import FitResult
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector, vector_from_rotation
from tests.workers.solver.draws import few_or_many
from tests.workers.solver.rigs import NOMINAL
from tests.workers.solver.walks import finish
from workers.solver.problem import fit_problem

SIZE = (1920, 1200)
NAMES = ("f_x", "f_y", "c_x", "c_y", "skew", "k1", "k2", "k3", "k4", "k5")
TRUE = dict(zip(NAMES, (1000.0, 1000.0, 960.0, 600.0, 0.0, -0.1, 0.02, 0.0005, -0.0005, 0.0), strict=True))
# Of another camera of the same kind: 1 % in focal length, 25 px in the centre.
OTHER = TRUE | {"f_x": 1010.0, "f_y": 1010.0, "c_x": 985.0, "c_y": 590.0, "k1": -0.08, "k2": 0.0}
SIGMAS = dict.fromkeys(("f_x", "f_y"), 5.0) | dict.fromkeys(("c_x", "c_y"), 9.6) | dict.fromkeys(("k3", "k4"), 0.002)


def opencv(points, R, t, lens):
    """(N, 2) pixels, as OpenCV projects points of the LiDAR's frame."""
    K = np.array([[lens["f_x"], 0.0, lens["c_x"]], [0.0, lens["f_y"], lens["c_y"]], [0.0, 0.0, 1.0]])
    D = np.array([lens[name] for name in ("k1", "k2", "k3", "k4", "k5")])
    return cv2.projectPoints(points, cv2.Rodrigues(R)[0], t, K, D)[0][:, 0]


class Walk:
    """222 marks of 1.2 px, 4 to 30 m away and within 0.9 m of height; the same points at 20 m, where they project."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.R = rotation_from_vector(np.radians(rng.uniform(-3, 3, 3))) @ FORWARD_LIDAR_TO_OPTICAL
        self.t = rng.uniform(-0.3, 0.3, 3)
        field = rng.uniform((4, -20, -0.45), (30, 20, 0.45), (4000, 3))
        field = field[(field @ self.R.T + self.t)[:, 2] > 0.7 * field[:, 0]]
        pixels = opencv(field, self.R, self.t, TRUE)
        seen = np.flatnonzero(np.all((pixels > 0) & (pixels < np.array(SIZE) - 1), axis=1))[:222]
        assert len(seen) == 222
        self.points, self.marks = field[seen], pixels[seen] + 1.2 * rng.normal(size=(222, 2))
        self.far = 20.0 * self.points / np.linalg.norm(self.points, axis=1)[:, None]
        self.at_20_m = opencv(self.far, self.R, self.t, TRUE)

    def result(self, stated, use, count=222):
        """The document of a fit that the stated lens holds so."""
        asked = {"model": "brown_conrady", "image_size": SIZE, "nominal": NOMINAL, "locked": {"skew": 0.0}}
        if use == "prior":
            asked["priors"] = {
                name: {"mean": value, "sigma": SIGMAS.get(name, 0.02)}
                for name, value in stated.items()
                if name != "skew"
            }
        if use == "locked":
            asked["locked"] = stated
        lens = {"model": "brown_conrady", **stated}
        problem = fit_problem(fit_request(**(asked | {"stated_lens": lens})), self.points[:count], self.marks[:count])
        turn = vector_from_rotation(self.R @ FORWARD_LIDAR_TO_OPTICAL.T)
        document = finish(problem, np.concatenate([turn, self.t, [TRUE[name] for name in NAMES]]))
        FitResult.model_validate(document)
        return document

    def miss_px(self, mount, lens):
        """RMS distance at 20 m of a mount with a lens from the truth."""
        R, t = np.array(mount["rotation"]["matrix"]), np.array(mount["translation_m"])
        return float(np.sqrt(np.mean(np.sum((opencv(self.far, R, t, lens) - self.at_20_m) ** 2, axis=1))))


@few_or_many(10, 200)
def test_the_mount_alone_meets_the_vehicles_own_projection_and_the_fitted_mount_does_not(draws):
    fitted, alone, stated = [], [], []
    for seed in range(draws):
        walk = Walk(seed)
        found = walk.result(TRUE, "free")
        assert found["lens"] == "fitted"
        fitted.append(walk.miss_px(found["transform"], TRUE))
        alone.append(walk.miss_px(found["stated_lens"]["transform"], TRUE))
        stated.append(found["stated_lens"]["explains"])
        assert walk.miss_px(found["transform"], found["intrinsics"]) < 1.0, "with its own lens it is right"
    assert max(alone) < 1.0 and np.median(fitted) > 3.0
    assert stated.count(False) <= draws // 100


@pytest.mark.parametrize(("use", "origin"), [("free", "fitted"), ("prior", "stated, refined"), ("locked", "stated")])
def test_the_lens_of_another_camera_is_named_by_its_misfit(use, origin):
    for seed in range(5):
        walk = Walk(seed)
        found = walk.result(OTHER, use)
        stated = found["stated_lens"]
        assert (found["lens"], stated["explains"]) == (origin, False)
        assert stated["rms_px"] > 1.5 * stated["free_lens_rms_px"]
        assert "does not fit these pairs" in stated["sentence"]
        true = walk.result(TRUE, use)
        assert true["stated_lens"]["explains"] is True


def test_the_mount_under_the_stated_lens_has_its_own_deviations():
    found = Walk(3).result(TRUE, "prior")
    stated = found["stated_lens"]
    assert stated["covariance"]["names"] == ["rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z"]
    for name in ("rotation_x", "rotation_y"):
        assert stated["std"][name] < 0.03 < 0.1 * 0.5 < 0.3 * found["std"][name], "the bound: 0.01 degrees, not 0.46"


def test_too_few_pairs_for_a_free_lens_cannot_tell():
    found = Walk(1).result(OTHER, "locked", count=8)
    assert found["stated_lens"]["explains"] is None and "too few" in found["stated_lens"]["sentence"]


def test_a_result_without_a_stated_lens_says_that_its_lens_was_fitted():
    walk = Walk(2)
    problem = fit_problem(fit_request(model="pinhole", image_size=SIZE, nominal=NOMINAL), walk.points, walk.marks)
    turn = vector_from_rotation(walk.R @ FORWARD_LIDAR_TO_OPTICAL.T)
    found = finish(problem, np.concatenate([turn, walk.t, [TRUE[name] for name in NAMES[:4]]]))
    assert (found["lens"], found["stated_lens"]) == ("fitted", None)
