"""Every number of a report, recomputed from pairs and stored documents with NumPy and OpenCV alone."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from apexcal.documents.results import ResultView
from tests.workers.reports.material import EDGES, made, steady
from tests.workers.solver.rigs import plain
from workers.reports.contents import contents

LENS = ("k1", "k2", "k3", "k4", "k5")


@pytest.fixture(scope="module")
def report():
    return contents(made())


def matrix(document):
    """R and t of T_camera_lidar, from the document's quaternion."""
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
