"""Every number of a report, recomputed from pairs and stored documents with NumPy and OpenCV alone."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import f as f_distribution

from apexcal.documents.results import ResultView
from tests.workers.reports.material import EDGES, made, steady
from tests.workers.solver.rigs import plain
from workers.reports.contents import contents

LENS = ("k1", "k2", "k3", "k4", "k5")


@pytest.fixture(scope="module")
def report():
    return contents(made())


def matrix(document):
    """R and t of T_camera_lidar, from the document's quaternion, or from R where a test turned it."""
    if "R" in document["transform"]:
        return document["transform"]["R"], np.array(document["transform"]["translation_m"])
    x, y, z, w = document["transform"]["rotation"]["quaternion_xyzw"]
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return R, np.array(document["transform"]["translation_m"])


def projected(document, points):
    """OpenCV's pixels of points in the LiDAR's frame, with the skew that it ignores."""
    R, t = matrix(document)
    lens = document["intrinsics"]
    distortion = np.array([lens.get(name) or 0.0 for name in LENS])
    plane = cv2.projectPoints(points @ R.T + t, np.zeros(3), np.zeros(3), np.eye(3), distortion)[0].reshape(-1, 2)
    skew = lens.get("skew") or 0.0
    return np.column_stack(
        [lens["f_x"] * (plane[:, 0] + skew * plane[:, 1]) + lens["c_x"], lens["f_y"] * plane[:, 1] + lens["c_y"]]
    )


def points_and_marks(material):
    pairs = material.pairs
    return [np.column_stack([pairs[name] for name in names]) for names in ("xyz", "uv")]


def test_the_pages_residuals_are_the_solvers(report):
    """What the page projects is pairs and a result, both rounded: OpenCV gets the solver's residuals out of them."""
    document = plain(made().result)
    columns = report["pairs"]
    points, marks = (np.column_stack([columns[name] for name in names]) for names in ("xyz", "uv"))
    error = np.hypot(*(marks - projected(report["result"], points)).T)
    assert np.abs(error - document["residuals_px"]).max() < 0.01
    assert columns["stamp_ns"][1] == "1700000000400000000"
    held = steady(columns["heldout_px"])
    assert np.allclose(held[::5], 0.5 + 0.01 * np.arange(0, 222, 5), rtol=1e-5) and np.isnan(held[1:5]).all()
    # The page's sizes: a file of 50,000 pairs is below 3 MB.
    assert "residuals_px" not in report["result"]


def test_each_person_has_their_own_marks(report):
    ann, ben = report["people"]
    assert (ann["name"], ben["name"]) == ("Ann", "Ben </script>$x$")
    for person, count in ((ann, 111), (ben, 222)):
        own = [(mark.u, mark.v) for mark in made().marks if mark.person == person["name"]]
        assert person["pair"] == list(range(count))
        assert np.abs(np.column_stack([person["u"], person["v"]]) - own).max() <= 5.1e-4


def test_figures_of_checks_are_counted_from_the_pairs(report):
    document = plain(made().result)
    figures = {one["name"]: one["figures"] for one in report["result"]["checks"]}
    outliers = document["outliers"]
    excluded = sum(one["excluded"] for one in outliers)
    assert figures["wrong_pairs"]["wrong"] == len(outliers) >= 3
    assert (figures["wrong_pairs"]["excluded"], figures["wrong_pairs"]["pairs"]) == (excluded, 222)
    marks = np.delete(points_and_marks(made())[1], [one["index"] for one in outliers], axis=0)
    size = document["intrinsics"]["image_size"]
    spans = (np.quantile(marks, 0.975, axis=0) - np.quantile(marks, 0.025, axis=0)) / size
    told = figures["coverage"]
    assert (told["width_share"], told["height_share"]) == pytest.approx(tuple(spans), rel=1e-5)
    assert f"{spans[0]:.0%} of the image's width" in next(
        one["sentence"] for one in report["result"]["checks"] if one["name"] == "coverage"
    )
    ratios = {f"{one['split']}_ratio": one["ratio"] for one in document["halves"]}
    assert {name: figures["halves"][name] for name in ratios} == pytest.approx(ratios, rel=1e-5)
    assert figures["elsewhere"] == {"agrees": 1, "disagrees": 0, "unknown": 1}


def changed(document, name, by):
    """The document with one parameter changed: degrees about the camera's axes, metres, pixels, coefficients."""
    found = {**document, "intrinsics": {**document["intrinsics"]}, "transform": {**document["transform"]}}
    if name.startswith("rotation_"):
        turn = cv2.Rodrigues(np.radians(by) * np.eye(3)["xyz".index(name[-1])])[0]
        found["transform"]["R"] = turn @ matrix(document)[0]
    elif name.startswith("t_"):
        t = matrix(document)[1] + by * np.eye(3)["xyz".index(name[-1])]
        found["transform"]["translation_m"] = t.tolist()
    else:
        found["intrinsics"][name] += by
    return found


def derivatives(document, points, step=1e-6):
    """(N, 2, F) of the pixels by the free parameters: finite differences through OpenCV."""
    return np.stack(
        [
            (projected(changed(document, name, step), points) - projected(changed(document, name, -step), points))
            / (2 * step)
            for name in document["covariance"]["names"]
        ],
        axis=2,
    )


def belonging(document):
    """(N,) bool, the pairs that the fit did not leave out."""
    used = np.ones(len(document["residuals_px"]), bool)
    used[[one["index"] for one in document["outliers"]]] = False
    return used


def refitted(material):
    """The reported result without its outliers: which pairs are used, and least squares from the stored optimum."""
    document = plain(material.result)
    points, marks = points_and_marks(material)
    used = belonging(document)
    for _ in range(5):
        J = derivatives(document, points[used]).reshape(2 * used.sum(), -1)
        residual = (projected(document, points[used]) - marks[used]).ravel()
        for name, by in zip(document["covariance"]["names"], np.linalg.lstsq(J, -residual)[0], strict=True):
            document = changed(document, name, by)
    return document, used


def further(document, used, points, marks, columns):
    """Further unknowns by which pixels change as columns (N, 2, e), solved for with all parameters by one step.

    Values, deviations, the probability of the F distribution, and the residuals that they explain, px. Combinations
    that the parameters themselves do to 98 % are left out.
    """
    J = derivatives(document, points[used]).reshape(2 * used.sum(), -1)
    residual = (projected(document, points[used]) - marks[used]).ravel()
    freedom = len(residual) - J.shape[1]
    variance = residual @ residual / freedom
    G = columns[used].reshape(len(residual), -1)
    scale = 1.0 / np.linalg.norm(G, axis=0)
    basis = np.linalg.qr(J / np.linalg.norm(J, axis=0))[0]
    _, left, turn = np.linalg.svd(G * scale - basis @ (basis.T @ (G * scale)), full_matrices=False)
    combined = scale[:, None] * turn[left > 0.02].T
    both = np.column_stack([J / np.linalg.norm(J, axis=0), G @ combined])
    count = combined.shape[1]
    step = np.linalg.lstsq(both, -residual)[0][-count:]
    C = variance * np.linalg.inv(both.T @ both)[-count:, -count:]
    statistic = step @ np.linalg.solve(C, step) / count
    deviations = np.sqrt(np.diag(combined @ C @ combined.T))
    pattern = columns @ (combined @ step)
    return combined @ step, deviations, f_distribution.sf(statistic, count, freedom), pattern


def test_the_pattern_of_a_lens_is_least_squares_of_the_residuals(report):
    material = made()
    points, marks = points_and_marks(material)
    document, used = refitted(material)
    lens = document["intrinsics"]
    away = projected(document, points) - (lens["c_x"], lens["c_y"])
    radius = np.linalg.norm(away, axis=1)
    share = radius / (0.5 * np.hypot(*lens["image_size"]))
    shifts = (away / radius[:, None])[:, :, None] * np.stack([share**k for k in range(1, 8)], axis=1)[:, None]
    x, y = (away / (0.5 * np.hypot(*lens["image_size"]))).T
    decentred = np.array([[3 * x * x + y * y, 2 * x * y], [2 * x * y, x * x + 3 * y * y]]).transpose(2, 1, 0)
    shifts = np.concatenate([shifts, decentred], axis=2)
    _, _, probability, pattern = further(document, used, points, marks, shifts)
    figures = next(one["figures"] for one in report["result"]["checks"] if one["name"] == "lens_model")
    assert figures["probability"] == pytest.approx(probability, rel=1e-4)
    size = np.hypot(*pattern[used].T)
    largest = np.quantile(size, 0.99)
    assert figures["pattern_px"] == pytest.approx(largest, rel=1e-3)
    # The angle told is that of a pair whose pattern is about the largest.
    R, t = matrix(plain(made().result))
    camera = points @ R.T + t
    angle = np.degrees(np.arctan2(np.hypot(*camera[:, :2].T), camera[:, 2]))[used]
    at = np.argmin(np.abs(angle - figures["pattern_at_deg"]))
    # The report's angles are under the fit that keeps the outliers.
    assert angle[at] == pytest.approx(figures["pattern_at_deg"], abs=1.0)
    assert size[at] == pytest.approx(largest, rel=0.1)


def test_the_rest_is_as_stored(report):
    document = plain(made().result)
    shown = {name: value for name, value in report["result"].items() if name in document}
    for name in ("checks", "outliers"):
        assert len(shown.pop(name)) >= len(document[name])
    provenance = shown.pop("provenance")
    assert provenance["request"] == {**document["provenance"]["request"], "image_size": [1280, 960]}
    assert shown == json.loads(json.dumps({name: document[name] for name in shown}))
    assert report["elsewhere"][0]["curves"][0]["at"] == EDGES["curves"][0]["at"]
    assert [one["sentence"] for one in report["elsewhere"]] == ["The mount fits.", "5 pairs are too few."]


def test_pairs_of_a_rolling_shutter_are_where_they_were_fitted():
    material = made()
    late = material.problem.points + np.array([0.0, 0.01, 0.0])
    columns = contents(replace(material, problem=replace(material.problem, points=late)))["pairs"]
    assert np.abs(np.column_stack([columns[name] for name in "xyz"]) - late).max() <= 5.1e-6


def test_a_report_is_what_the_service_answers_of_a_result(report):
    """Of the members of a ResultView only those are missing that the page does without."""
    missing = set(ResultView.model_fields) - set(report["result"])
    assert missing == {"residuals_px", "history", "heldout", "evaluations", "created_at"}
    first = report["result"]["outliers"][0]
    assert first["pair"]["u"] == made().pairs["u"][first["index"]]
