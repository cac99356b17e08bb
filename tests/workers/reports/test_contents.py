"""Every number of a report, recomputed from pairs and stored documents with NumPy and OpenCV alone."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.stats import f as f_distribution

from apexcal.documents.results import FitResult
from tests.workers.reports.material import EDGES, made, steady
from tests.workers.solver.rigs import plain
from workers.reports.contents import contents
from workers.reports.page import page

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


def test_every_pair_is_where_opencv_projects_it(report):
    material = made()
    points, marks = points_and_marks(material)
    document = plain(material.chosen.result)
    at = projected(document, points)
    columns = report["pairs"]
    for name, values in (("projected_u", at[:, 0]), ("projected_v", at[:, 1])):
        assert np.allclose(steady(columns[name]), values, rtol=5.1e-6, atol=1e-6)  # six digits
    off = marks - at
    assert np.abs(steady(columns["off_u"]) - off[:, 0]).max() < 1e-4
    assert np.abs(steady(columns["off_v"]) - off[:, 1]).max() < 1e-4
    assert np.allclose(steady(columns["error_px"]), np.hypot(*off.T), rtol=1e-5, atol=1e-6)
    assert np.allclose(steady(columns["error_px"]), document["residuals_px"], rtol=1e-5)
    R, t = matrix(document)
    camera = points @ R.T + t
    angle = np.degrees(np.arccos(camera[:, 2] / np.linalg.norm(camera, axis=1)))
    assert np.allclose(steady(columns["angle_deg"]), angle, rtol=1e-5, atol=1e-5)
    assert np.allclose(steady(columns["range_m"]), np.sqrt((points**2).sum(axis=1)), rtol=1e-5)
    assert np.allclose(steady(columns["seconds"]), 0.4 * np.arange(len(points)), rtol=1e-5)
    assert columns["stamp_ns"][1] == "1700000000400000000"
    held = steady(columns["heldout_px"])
    assert np.allclose(held[::5], 0.5 + 0.01 * np.arange(0, 222, 5), rtol=1e-5) and np.isnan(held[1:5]).all()


def test_each_person_is_judged_by_their_own_marks(report):
    at = projected(plain(made().chosen.result), points_and_marks(made())[0])
    ann, ben = report["people"]
    assert (ann["name"], ben["name"]) == ("Ann", "Ben </script>$x$")
    for person, count in ((ann, 111), (ben, 222)):
        own = np.array([(one.u, one.v) for one in made().marks if one.person == person["name"]]) - at[:count]
        assert person["pair"] == list(range(count))
        assert np.abs(np.column_stack([person["off_u"], person["off_v"]]) - own).max() < 1e-3
        assert person["mean_u"] == pytest.approx(own[:, 0].mean(), rel=1e-4)
        assert person["mean_v"] == pytest.approx(own[:, 1].mean(), rel=1e-4, abs=1e-6)
        assert person["rms_px"] == pytest.approx(np.sqrt((own**2).sum(axis=1).mean()), rel=1e-4)


def rays_of(document, u, v):
    """(N, 3) unit vectors in the camera's frame of pixels, by OpenCV's inverse of the distortion."""
    lens = document["intrinsics"]
    y = (v - lens["c_y"]) / lens["f_y"]
    plane = np.column_stack([(u - lens["c_x"]) / lens["f_x"] - (lens.get("skew") or 0.0) * y, y])
    distortion = np.array([lens.get(name) or 0.0 for name in LENS])
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    plane = cv2.undistortPoints(plane[:, None], np.eye(3), distortion, criteria=criteria).reshape(-1, 2)
    rays = np.column_stack([plane, np.ones(len(plane))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def test_what_is_said_of_each_model_is_its_own_pairs(report):
    material = made()
    points, marks = points_and_marks(material)
    assert set(report["models"]) == {one.result.model for one in material.models}
    for model in material.models:
        error = np.hypot(*(marks - projected(plain(model.result), points)).T)[belonging(plain(model.result))]
        told = report["models"][model.result.model]
        assert told["mean_px"] == pytest.approx(error.mean(), rel=1e-5)
        assert told["rms_px"] == pytest.approx(np.sqrt((error**2).mean()), rel=1e-5)
        assert (told["status"], told["measured_on"]) == (model.result.status, "held-out pairs")
    slots = np.array(material.slots)
    for name, column in (("iteration", 0), ("slot", 1), ("loss_px", 2)):
        assert np.allclose(report["slots"][name], slots[:, column], rtol=1e-5)
    assert report["elsewhere"][0]["curves"][0]["at"] == pytest.approx(EDGES["curves"][0]["at"], rel=1e-5, abs=1e-9)
    assert [one["sentence"] for one in report["elsewhere"]] == ["The mount fits.", "5 pairs are too few."]


def test_figures_of_checks_are_counted_from_the_pairs(report):
    document = plain(made().chosen.result)
    figures = {one["name"]: one["figures"] for one in report["checks"]}
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
        one["sentence"] for one in report["checks"] if one["name"] == "coverage"
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


def deviation(material, model, points):
    """px: derivatives times the stored covariance."""
    document = next(plain(one.result) for one in material.models if one.result.model == model)
    J, size = derivatives(document, points), np.array(document["intrinsics"]["image_size"])
    spread = np.einsum("ncf,fg,ncg->n", J, np.array(document["covariance"]["matrix"]), J)
    at = projected(document, points)
    return np.sqrt(spread), np.all((at >= -0.5) & (at <= size - 0.5), axis=1)


@pytest.mark.parametrize("model", ["pinhole", "brown_conrady"])
def test_maps_are_the_covariance_carried_to_each_cell(report, model):
    material = made()
    points, marks = points_and_marks(material)
    found = report["models"][model]
    ground = found["ground"]
    across, down = np.meshgrid(ground["across"], ground["down"])
    cells = np.column_stack([across.ravel(), down.ravel(), np.full(across.size, np.median(points[:, 2]))])
    sigma, inside = deviation(material, model, cells)
    told = np.array(ground["sigma_px"], np.float64).ravel()
    shown = np.isfinite(told)
    assert shown.sum() > 500
    assert np.allclose(told[shown], sigma[shown], rtol=2e-3)
    assert inside[shown].all()
    document = next(plain(one.result) for one in material.models if one.result.model == model)
    image = found["image"]
    R, t = matrix(document)
    distance = np.median(np.linalg.norm(points @ R.T + t, axis=1))
    assert image["distance_m"] == pytest.approx(distance, rel=1e-5)
    u, v = (values.ravel() for values in np.meshgrid(image["across"], image["down"]))
    rays = distance * rays_of(document, u, v)
    sigma, _ = deviation(material, model, (rays - t) @ R)
    told = np.array(image["sigma_px"], np.float64).ravel()
    shown = np.isfinite(told)
    assert shown.mean() > 0.8 and np.allclose(told[shown], sigma[shown], rtol=5e-3)
    error = np.hypot(*(marks - projected(document, points)).T)
    held = 0.5 + 0.01 * np.arange(len(points))
    expected = np.where(np.arange(len(points)) % 5 == 0, held, error)
    assert np.allclose(steady(found["measured_px"]), expected, rtol=1e-4)


def test_coverage_counts_and_names_what_is_missing(report):
    material = made()
    points, marks = points_and_marks(material)
    width = plain(material.chosen.result)["intrinsics"]["image_size"][0]
    field = report["coverage"]
    distance = np.linalg.norm(points, axis=1)
    column = np.floor((marks[:, 0] + 0.5) / (width / 6)).astype(int)
    for band, row in enumerate(field["pairs"]):
        near = (distance >= field["edges_m"][band]) & (distance < field["edges_m"][band + 1])
        assert row == [int(np.count_nonzero(near & (column == c))) for c in range(6)]
    assert sum(map(sum, field["pairs"])) == len(points)
    empty = [(band, c) for band, row in enumerate(field["pairs"]) for c in range(6) if row[c] == 0 and any(row)]
    if any(c == 5 for _, c in empty):
        assert any("right of" in one for one in field["missing"])


def belonging(document):
    """(N,) bool, the pairs that the fit did not leave out."""
    used = np.ones(len(document["residuals_px"]), bool)
    used[[one["index"] for one in document["outliers"]]] = False
    return used


def refitted(material):
    """The reported result without its outliers: which pairs are used, and least squares from the stored optimum."""
    document = plain(material.chosen.result)
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
    figures = next(one["figures"] for one in report["checks"] if one["name"] == "lens_model")
    assert figures["probability"] == pytest.approx(probability, rel=1e-4)
    size = np.hypot(*pattern[used].T)
    largest = np.quantile(size, 0.99)
    assert figures["pattern_px"] == pytest.approx(largest, rel=1e-3)
    # The angle told is that of a pair whose pattern is about the largest.
    angle = steady(report["pairs"]["angle_deg"])[used]
    at = np.argmin(np.abs(angle - figures["pattern_at_deg"]))
    # The report's angles are under the fit that keeps the outliers.
    assert angle[at] == pytest.approx(figures["pattern_at_deg"], abs=1.0)
    assert size[at] == pytest.approx(largest, rel=0.1)


def test_rings_off_the_axis_are_the_pairs_own(report):
    rings = report["rings"]
    used = belonging(plain(made().chosen.result))
    angle, error = (steady(report["pairs"][name])[used] for name in ("angle_deg", "error_px"))
    assert sum(ring["pairs"] for ring in rings) == used.sum()
    for k, ring in enumerate(rings):
        end = np.inf if k == 3 else ring["to_deg"]
        within = (angle >= ring["from_deg"] - 1e-4) & (angle < end - 1e-4)
        if abs(int(within.sum()) - ring["pairs"]) == 0:
            assert ring["rms_px"] == pytest.approx(np.sqrt((error[within] ** 2).mean()), rel=1e-3)
        else:
            assert abs(int(within.sum()) - ring["pairs"]) <= 1


def test_the_rest_is_as_stored(report):
    document = plain(made().chosen.result)
    for name in ("parameters", "std", "interval95_half_width", "intrinsics"):
        for key, value in document[name].items():
            told = report["result"][name][key]
            assert told == pytest.approx(value, rel=1e-5) if isinstance(value, float) else told == value
    assert np.allclose(report["result"]["correlation"], document["correlation"], rtol=1e-4, atol=1e-9)
    assert [one["index"] for one in report["result"]["outliers"]] == [one["index"] for one in document["outliers"]]
    assert report["slots"]["loss_px"] == pytest.approx([loss for _, _, loss in made().slots], rel=1e-5)
    assert report["provenance"] == {"request": {**document["provenance"]["request"], "image_size": [1280, 960]}} | {
        "pairs_sha256": "00",
        "sources_sha256": "11",
    }
    prediction = report["result"]["prediction"]
    for told, stored in zip(prediction["points"], document["prediction"]["points"], strict=True):
        assert told["stated_px"] == pytest.approx(stored["stated_px"], rel=1e-5)


def test_pairs_that_say_who_marked_them_have_a_report():
    material = made()
    people = np.eye(2)[np.arange(222) % 2]
    problems = {
        one.result.model: replace(one.problem, people=people, common_errors={"person_px": 0.3})
        for one in material.models
    }
    models = [replace(one, problem=problems[one.result.model]) for one in material.models]
    chosen = next(one for one in models if one.result.model == material.chosen.result.model)
    document = contents(replace(material, models=models, chosen=chosen))
    assert np.isfinite(steady(document["models"]["pinhole"]["ground"]["sigma_px"])).any()


def test_pairs_of_a_rolling_shutter_are_where_they_were_fitted():
    material = made()
    late = material.chosen.problem.points + np.array([0.0, 0.01, 0.0])
    chosen = replace(material.chosen, problem=replace(material.chosen.problem, points=late))
    columns = contents(replace(material, chosen=chosen))["pairs"]
    assert np.allclose(steady(columns["projected_u"]), projected(plain(chosen.result), late)[:, 0], rtol=5.1e-6)


def test_results_that_state_no_deviations_have_a_page():
    material = made()
    open_covariance = {"names": [], "units": [], "matrix": []}
    nothing = {"std": {}, "interval95_half_width": {}, "correlation": [], "covariance": open_covariance}
    result = FitResult.model_validate(plain(material.chosen.result) | nothing)
    chosen = replace(material.chosen, result=result)
    assert '<th scope="row">' in page(contents(replace(material, chosen=chosen)))
