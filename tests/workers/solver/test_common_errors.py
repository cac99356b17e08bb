"""The biases of people who mark: how large, and what they add to the deviations, computed again with NumPy."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from scipy import integrate

from apexcal.documents.common_errors import CommonError, CommonErrors
from tests.workers.solver.rigs import simulated
from tests.workers.solver.walks import Recomputed, finish, posed, walked
from workers.solver.common_errors import common_errors, shares_of

STATED = {"person_px": 0.289}


def mark_by_turns(random, n, people):
    return random.integers(people, size=n)


def marked(seed, people, bias_px, rule=mark_by_turns, stated_px=0.289):
    """(problem, truth) of a walk that so many people marked, each with a bias of that deviation."""
    problem, truth = walked(seed)
    random = np.random.default_rng([seed, 5])
    person = rule(random, len(problem.points), people)
    bias = random.normal(0.0, bias_px, (people, 2))
    shares = shares_of({"marked_by": [[one] for one in person.tolist()]})
    given = {"pixels": problem.pixels + bias[person], "people": shares, "common_errors": {"person_px": stated_px}}
    return replace(problem, **given), truth


def test_shares_are_those_of_the_people_of_each_mark():
    assert shares_of({"x": [1.0]}) is None
    found = shares_of({"marked_by": [[1], [0, 2], [0]]})
    assert found.tolist() == [[0.0, 1.0, 0.0], [0.5, 0.0, 0.5], [1.0, 0.0, 0.0]]


def test_the_bias_of_one_person_moves_the_result_as_a_shift_of_all_marks():
    plain, truth = walked(31)
    document = finish(replace(plain, common_errors=STATED), truth)
    before = finish(plain, truth)
    assert document["person_bias"] == {"px": 0.289, "freedom": 4.5, "people": 1} and before["person_bias"] is None
    assert document["polished"] == before["polished"]
    again, without = (Recomputed(one, plain.points, plain.pixels) for one in (document, before))
    arm = np.linalg.solve(again.J.T @ again.J, again.J.T @ np.tile(np.eye(2), (len(plain.points), 1)))
    part = 0.289**2 * arm @ arm.T
    grown = without.covariance + part
    scale = np.sqrt(np.outer(np.diag(grown), np.diag(grown)))
    np.testing.assert_allclose(again.covariance / scale, grown / scale, atol=1e-4)
    # Satterthwaite: each part with its own degrees of freedom.
    unsure = np.diag(without.covariance) ** 2 / (2 * len(plain.points) - 10) + np.diag(part) ** 2 / 4.5
    freedom = np.diag(grown) ** 2 / unsure
    np.testing.assert_allclose(list(document["degrees_of_freedom"].values()), freedom, rtol=1e-3)


def test_differences_between_people_tell_how_large_biases_are():
    problem, truth = marked(33, 4, 1.5)
    document = finish(problem, truth)
    again = Recomputed(document, problem.points, problem.pixels)
    # Each person's shift as an unknown of the fit, without that of all people.
    contrasts = np.linalg.svd(np.eye(4) - 0.25)[2][:3]
    columns = np.einsum("np,kp,ab->nakb", problem.people, contrasts, np.eye(2)).reshape(-1, 6)
    A = np.concatenate([again.J, -columns], axis=1)
    scale = np.linalg.norm(A, axis=0)
    normal = np.linalg.inv((A / scale).T @ (A / scale))
    step = -(normal @ (A / scale).T @ again.residuals) / scale
    covariance = document["sigma_px"] ** 2 * normal / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(covariance[-6:, -6:])
    squares = (vectors.T @ step[-6:]) ** 2

    def density(log_variance, power):
        variance = np.exp(log_variance)
        likelihood = np.prod(np.exp(-0.5 * squares / (variance + values)) / np.sqrt(variance + values))
        return likelihood * variance ** (-4.5 / 2 - power) * np.exp(-4.5 * 0.289**2 / (2.0 * variance))

    whole, inverse, second = (integrate.quad(density, -8.0, 6.0, (power,))[0] for power in (0, 1, 2))
    mean = inverse / whole
    assert document["person_bias"]["px"] == pytest.approx(np.sqrt(1.0 / mean), rel=1e-3)
    freedom = 2.0 * mean**2 / (second / whole - mean**2)
    assert document["person_bias"]["freedom"] == pytest.approx(freedom, rel=1e-2)
    assert document["person_bias"]["px"] > 0.7 and document["person_bias"]["freedom"] > 6.0


def test_a_person_with_few_pairs_tells_nothing():
    problem, truth = simulated("pinhole", 35, common_errors=STATED)
    shares = np.zeros((len(problem.points), 2))
    shares[:3, 1] = shares[3:, 0] = 1.0
    document = finish(replace(problem, people=shares), truth)
    assert document["person_bias"] == {"px": 0.289, "freedom": 4.5, "people": 2}


def test_corners_that_are_out_in_all_poses_are_no_error_of_single_poses():
    """Taken for errors of poses they would widen the mount though they hardly move it."""
    problem, truth = posed(7, noise_px=0.5)
    middles = problem.points.reshape(-1, 4, 3).mean(axis=1)
    arms = problem.points - np.repeat(middles, 4, axis=0)
    out = replace(problem, points=problem.points + 0.012 * arms / np.linalg.norm(arms, axis=1, keepdims=True))
    plain, shared = (finish(replace(out, common_errors=stated), truth) for stated in ({}, {"corners_out_mm": 12.0}))
    offsets = [document["shared_errors"]["deviations"]["offset_m"] for document in (plain, shared)]
    assert offsets[1] < offsets[0] or offsets == [0.0, 0.0]
    assert shared["shared_errors"]["noise_px"] < 0.8 * plain["shared_errors"]["noise_px"]


def test_the_fit_counts_every_common_error_that_a_request_may_state():
    names = {*get_args(CommonError)}
    assert names == {*CommonErrors.model_fields}
    problem, truth = walked(31)
    moving = replace(problem, velocities=np.ones_like(problem.points), common_errors=dict.fromkeys(names, 1.0))
    assert {*common_errors(moving, truth)[1]} == names - {"person_px"}
