"""The recommended model is the smallest that held-out pairs do not rule out; on simulated rigs the true one."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.fit_requests import fit_request
from tests.workers.solver.draws import few_or_many
from tests.workers.solver.rigs import NOMINAL, SIZE, simulated
from workers.geometry.models import INTRINSICS
from workers.models.choice import Candidate, choose
from workers.models.evidence import Pairs, evidence_of_models
from workers.solver.estimate import estimate
from workers.solver.held_out import folds
from workers.solver.polish import distances, polish
from workers.solver.problem import fit_problem

AREA_PX2 = 1280.0 * 960.0
FREE = {"pinhole": 10, "brown_conrady": 16, "kannala_brandt": 14}


def pairs(errors, per_block=10, stretch=None):
    errors = np.asarray(errors, float)
    number = np.arange(len(errors))
    return Pairs(number, number // per_block, errors, np.ones(len(errors)) if stretch is None else stretch, errors)


def candidate(model, errors, **more):
    of = {"free_parameters": FREE[model], "parameters": len(INTRINSICS[model])} | more
    return Candidate(fitted=pairs(errors), heldout=pairs(errors), **of)


def noise(count, seed=0):
    return np.random.default_rng(seed).normal(size=(count, 2))


def off(marks, pixels):
    """Distances where a model lies `pixels` off along a direction that turns from pair to pair."""
    angle = np.arange(len(marks)) * 2.4
    return np.hypot(*(marks + pixels * np.column_stack([np.cos(angle), np.sin(angle)])).T)


def test_the_log_likelihood_is_the_largest_of_a_gaussian_with_wrong_marks_anywhere():
    errors = np.concatenate([off(noise(200), 0.0), [90.0, 300.0, 2400.0]])
    found = evidence_of_models({"pinhole": pairs(errors)}, AREA_PX2)
    sigma, share = np.meshgrid(np.linspace(0.8, 1.2, 81), np.linspace(0.005, 0.05, 46))
    density = (1 - share)[..., None] * np.exp(-(errors**2) / 2 / (sigma**2)[..., None]) / (2 * np.pi * sigma**2)[
        ..., None
    ] + share[..., None] / AREA_PX2
    assert found.log_likelihood["pinhole"].sum() == pytest.approx(np.log(density).sum(axis=-1).max(), abs=0.2)
    assert found.sigma_px["pinhole"] == pytest.approx(1.0, abs=0.1)
    assert np.all(found.belongs[-3:] < 1e-6) and np.median(found.belongs[:-3]) > 0.99


def test_the_density_is_that_of_pixels_however_the_distances_are_scaled():
    errors = off(noise(100), 0.0)
    scaled = replace(pairs(3.0 * errors, stretch=np.full(100, 3.0)), errors_px=errors)
    plain, other = (
        evidence_of_models({"pinhole": one}, AREA_PX2).total["pinhole"] for one in (pairs(errors), scaled)
    )
    assert other == pytest.approx(plain, abs=1e-6)


def chosen(**errors):
    """The choice between models whose held-out and fitted pairs have these errors."""
    return choose({model: candidate(model, of_model) for model, of_model in errors.items()}, AREA_PX2)


def test_models_that_predict_alike_leave_it_to_the_number_of_parameters():
    marks = noise(222)
    choice = chosen(pinhole=off(marks, 0.05), brown_conrady=off(marks, 0.0))
    assert choice.recommended == "pinhole"
    assert "it has 10 free parameters instead of 16" in choice.why or choice.why.startswith("pinhole fits")


def test_a_certain_gain_counts_however_small_it_is_in_per_cent():
    """0.2 px over the field, 786 pairs: 1 % of the mean error, and 20 deviations of the mount."""
    marks = noise(786, 3)
    choice = chosen(kannala_brandt=off(marks, 0.2), brown_conrady=off(marks, 0.0))
    behind = choice.behind["kannala_brandt"]
    assert choice.recommended == "brown_conrady"
    assert behind.percent < 2.0 and behind.log_likelihood > 8.0


def test_wrong_marks_say_nothing_for_a_model_that_rejects_none():
    marks = noise(222, 5)
    good, poor = off(marks, 0.0), off(marks, 1.0)
    wrong = np.random.default_rng(1).choice(222, 22, replace=False)
    good[wrong], poor[wrong] = 60.0, 45.0
    assert good.mean() > poor.mean()
    choice = chosen(pinhole=poor, brown_conrady=good)
    assert choice.recommended == "brown_conrady"
    clean = np.setdiff1d(np.arange(222), wrong)
    assert choice.behind["pinhole"].px == pytest.approx(np.mean((poor - good)[clean]), rel=0.02)


def test_one_projection_that_is_none_decides_nothing_and_a_lens_missed_by_very_different_amounts_is_missed():
    marks = noise(80)
    small, large = off(marks, 1.0), off(marks, 0.0)
    large[17] = 2364.0
    assert chosen(kannala_brandt=small, brown_conrady=large).recommended == "brown_conrady"
    mixed = np.concatenate([off(marks[:20], 0.5), off(marks[20:40], 2.0), off(marks[40:60], 50.0)])
    assert chosen(pinhole=mixed, brown_conrady=off(marks[:60], 0.0)).recommended == "brown_conrady"


def test_a_lens_that_is_locked_to_none_is_that_of_fewer_parameters():
    errors = off(noise(100), 0.0)
    locked = candidate("brown_conrady", errors, free_parameters=10)
    choice = choose({"brown_conrady": locked, "pinhole": candidate("pinhole", errors)}, AREA_PX2)
    assert choice.recommended == "pinhole"
    assert next(iter(choice.behind.values())).log_likelihood == 0.0


def test_a_model_on_its_bounds_gives_way_to_one_inside_that_predicts_alike():
    marks = noise(80)
    edge = candidate("kannala_brandt", off(marks, 0.0), at_bounds=["k4"])
    inside = candidate("brown_conrady", off(marks, 0.1))
    choice = choose({"kannala_brandt": edge, "brown_conrady": inside}, AREA_PX2)
    assert choice.recommended == "brown_conrady"
    assert "kannala_brandt lies on the edge of its bounds (k4)" in choice.why or choice.why.startswith(
        "brown_conrady fits"
    )


def test_without_held_out_pairs_the_fitted_errors_pay_for_their_parameters():
    marks = noise(222)
    errors = {"pinhole": off(marks, 0.05), "brown_conrady": off(marks, 0.0)}
    none = {model: replace(candidate(model, of_model), heldout=None) for model, of_model in errors.items()}
    choice = choose(none, AREA_PX2)
    assert choice.recommended == "pinhole" and "None were held out" in choice.why
    far = none | {"pinhole": replace(none["pinhole"], fitted=pairs(off(marks, 1.0)))}
    assert choose(far, AREA_PX2).recommended == "brown_conrady"


def test_models_of_which_no_common_pair_was_held_out_are_not_ranked():
    errors = pairs(off(noise(20), 0.0))
    halves = {"pinhole": np.arange(10), "brown_conrady": np.arange(10, 20)}
    models = {
        name: replace(candidate(name, errors.errors_px), heldout=errors.of(half)) for name, half in halves.items()
    }
    choice = choose(models, AREA_PX2)
    assert choice.recommended is None and "cannot be compared" in choice.why and "fewer folds" not in choice.why


def held_out(problem, start):
    """The model's errors on each of five folds under the fit to the others, from near its optimum."""
    lens = len(INTRINSICS[problem.model])
    start = np.concatenate([start[:10], np.zeros(lens - 4)]) if len(start) != 6 + lens else start
    best = np.array(polish(problem, start).parameters)
    count = len(problem.points)
    errors, block = np.zeros(count), np.zeros(count, int)
    for fold in folds(np.arange(count), 5):
        weights = np.ones(count)
        weights[fold.indices] = 0.0
        p = estimate(replace(problem, weights=weights), best).parameters
        errors[fold.indices], block[fold.indices] = distances(problem, p)[fold.indices], fold.blocks
    found = Pairs(np.arange(count), block, errors, np.ones(count), errors)
    return Candidate(6 + lens, lens, found, found)


@few_or_many(2, 5)
@pytest.mark.parametrize("share", [0.0, 0.05])
@pytest.mark.parametrize("truth", ["pinhole", "brown_conrady"])
def test_the_true_model_is_recommended_on_simulated_rigs(truth, share, draws):
    """Of each rig, without and with marks of another corner 40 px away, which the fits exclude."""
    wrong = 0
    for seed in range(draws):
        problem, parameters = simulated(truth, 500 + seed)
        rng = np.random.default_rng(seed)
        marks = problem.pixels.copy()
        spoiled = rng.choice(len(marks), round(share * len(marks)), replace=False)
        marks[spoiled] += rng.choice([-40.0, 40.0], (len(spoiled), 2))
        order = np.argsort(problem.points[:, 1] / problem.points[:, 0])
        models = {}
        for model in ("pinhole", "brown_conrady"):
            document = {"model": model, "image_size": SIZE, "nominal": NOMINAL, "outliers": "exclude"}
            one = fit_problem(fit_request(**document), problem.points[order], marks[order])
            start = parameters if model == truth else parameters[:10]
            models[model] = held_out(one, start)
        wrong += choose(models, SIZE[0] * SIZE[1]).recommended != truth
    assert wrong == 0
