"""Pairs weigh by the errors that they state: what a request comes to, and what the workers make of it."""

import math

import numpy as np
import pytest

from service.platform.db.calibrations import CalibrationRun
from tests.service.calibrations.test_routes import add_set, ask, documents
from tests.support.asking import bring_pairs
from workers.tasks.run_inputs import read_run

SIGMAS = {"sigma_azimuth_rad": 1e-3, "sigma_elevation_rad": 2e-3, "sigma_range_m": 0.01}


def test_all_pairs_that_state_errors_weigh_by_them_unless_equal_is_asked_for(api, engineer, rig):
    plain, stated, marked = (add_set(engineer, rig, **extra) for extra in ({}, SIGMAS, {"sigma_px": 0.7}))
    known = {"models": ["pinhole"], "folds": 0}

    def outcome(made, **extra):
        answer = ask(engineer, rig, made, **known, **extra)
        assert answer.status_code == 202, answer.text
        document = documents(api, answer.json()["id"])["pinhole", -1]
        said = any("weigh by the standard deviations" in note for note in answer.json()["notes"])
        assert said == (document["weights"] == "covariances")
        return document

    for made in (stated, marked):
        assert outcome(made)["weights"] == outcome(made, weights="covariances")["weights"] == "covariances"
        assert outcome(made, weights="equal")["weights"] == "equal"
        assert outcome(made)["seed"] != outcome(made, weights="equal")["seed"]
    assert outcome(plain)["weights"] == "equal"
    assert outcome(plain) == outcome(plain, weights="equal")
    refused = ask(engineer, rig, plain, **known, weights="covariances")
    assert (refused.status_code, refused.json()["code"]) == (422, "no_covariances")
    assert "sigma_azimuth_rad" in refused.json()["hint"]
    assert ask(engineer, rig, plain, **known, weights="marks").status_code == 422


def test_the_run_solves_by_the_covariances_of_the_pairs_that_it_fits(api, engineer, rig):
    made = add_set(engineer, rig, **SIGMAS)
    with api.database.reading() as session:
        answer = ask(engineer, rig, made, models=["pinhole"], folds=3, locked={"t_x": 0.0})
        runs = {run.fold: run for run in session.query(CalibrationRun)}
        assert answer.status_code == 202
        n = np.arange(60)
        pairs = {"x": 4 + 0.1 * n, "y": n % 7 - 3.0, "z": 0.3 + 0 * n, "u": 10.0 + n, "v": 20.0 + 0 * n}
        pairs = {name: values.tolist() for name, values in pairs.items()} | {"stamp_ns": (n * 10**8).tolist()}
        pairs |= {name: (value * (1 + n)).tolist() for name, value in SIGMAS.items()}
        whole, fold = (read_run(run.fit_request, run.fold, pairs).problem for run in (runs[-1], runs[1]))
    assert len(whole.points) == len(whole.covariances.points) == 60
    kept = [round((x - 4) / 0.1) for x in fold.points[:, 0]]
    assert 0 < len(kept) < 60
    np.testing.assert_array_equal(fold.covariances.points, whole.covariances.points[kept])
    spread = math.sqrt(np.trace(whole.covariances.points[0]))
    distance = np.linalg.norm(whole.points[0])
    flat = np.hypot(*whole.points[0, :2])
    assert spread == pytest.approx(math.sqrt((1e-3 * flat) ** 2 + (2e-3 * distance) ** 2 + 0.01**2))


def test_a_deviation_of_the_clocks_needs_pairs_that_move(engineer, rig):
    """It was refused after the search only."""

    def brought(stamp_ns):
        pairs = [{"x": 4 + 0.1 * n, "y": n % 7 - 3.0, "z": 0.3, "u": 10.0 + n, "v": 20.0} for n in range(60)]
        pairs = [one | stamp_ns(n) for n, one in enumerate(pairs)]
        return bring_pairs(engineer, rig.id, pairs)

    walk = brought(lambda n: {"stamp_ns": n * 10**8})
    apart = brought(lambda n: {"stamp_ns": n * 10**9})
    at_once = brought(lambda n: {"stamp_ns": n // 10 * 10**9})
    none = brought(lambda n: {})
    for name in ("clock_ms", "line_time_us"):
        asked = {"models": ["pinhole"], "folds": 0, "common_errors": {name: 2.0}}
        assert ask(engineer, rig, walk, **asked).status_code == 202
        for made in (apart, at_once, none):
            refused = ask(engineer, rig, made, **asked)
            assert (refused.status_code, refused.json()["code"]) == (422, "no_motion"), refused.text
            assert name in refused.json()["detail"]
        assert ask(engineer, rig, apart, **asked | {"common_errors": {name: 0.0}}).status_code == 202
