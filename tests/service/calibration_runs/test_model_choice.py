"""The smallest model within the noise of the lowest held-out error; on simulated rigs, the true one."""

import numpy as np
import pytest

from service.calibration_runs.model_choice import Candidate, choose
from tests.workers.solver.rigs import NOMINAL, SIZE, simulated
from workers.geometry.models import INTRINSICS
from workers.solver.folds import folds
from workers.solver.polish import distances, polish
from workers.solver.problem_document import problem_from_document


def blocks(*errors):
    """Blocks of neighbouring pairs."""
    found, first = {}, 0
    for fold, block in enumerate(errors):
        found[fold] = {first + place: error for place, error in enumerate(block)}
        first += len(block)
    return found


def candidates(small, large):
    return {"pinhole": Candidate(10, 1.0, blocks(*small)), "brown_conrady": Candidate(16, 0.9, blocks(*large))}


def test_a_hair_does_not_recommend_the_larger_model():
    small = [[1.00, 1.20], [0.90, 1.10], [1.05, 0.95]]
    large = [[0.99, 1.21], [0.91, 1.04], [1.06, 0.95]]
    choice = choose(candidates(small, large))
    assert choice.recommended == "pinhole"
    difference = choice.behind["pinhole"]
    d = np.array(small).ravel() - np.array(large).ravel()
    sums = (d - d.mean()).reshape(3, 2).sum(axis=1)
    assert difference.px == pytest.approx(d.mean())
    assert difference.standard_error_px == pytest.approx(np.sqrt(3 / 2 * (sums**2).sum()) / 6)
    ratios = np.log(np.mean(small, axis=1) / np.mean(large, axis=1))
    assert np.log1p(difference.percent / 100) == pytest.approx(ratios.mean())
    assert np.log1p(difference.standard_error_percent / 100) == pytest.approx(ratios.std(ddof=1) / np.sqrt(3))
    assert difference.within_noise
    assert "pinhole is 0.01 ± 0.01 px behind brown_conrady (block by block 0.7 ± 0.9 %), within the noise" in (
        choice.why
    )
    assert "Where that is all, the smaller model is recommended: pinhole, with 10 free parameters instead of 16" in (
        choice.why
    )


def test_a_sure_gain_of_a_hair_does_not_recommend_the_larger_model_either():
    choice = choose(candidates([[1.015, 1.015]] * 4, [[1.0, 1.0]] * 4))
    assert choice.recommended == "pinhole"
    assert "(block by block 1.5 ± 0.0 %), no more than 2 %" in choice.why


def test_a_gain_in_every_block_recommends_the_larger_model():
    choice = choose(candidates([[2.0, 2.2], [1.9, 2.1], [2.05, 2.0]], [[1.0, 1.2], [0.9, 1.1], [1.0, 1.0]]))
    assert choice.recommended == "brown_conrady"
    assert not choice.behind["pinhole"].within_noise
    assert "more than noise" in choice.why and "smaller model" not in choice.why


def test_a_lens_that_is_missed_by_very_different_amounts_is_still_missed():
    """Half a pixel, two and fifty: by the mean's own standard error that would be noise."""
    choice = choose(candidates([[1.5, 1.5], [3.0, 3.0], [51.0, 51.0]], [[1.0, 1.0], [1.0, 1.0], [1.0, 1.0]]))
    difference = choice.behind["pinhole"]
    assert choice.recommended == "brown_conrady"
    assert difference.px < 1.2 * difference.standard_error_px


def test_a_gain_in_one_block_alone_is_noise():
    choice = choose(candidates([[2.0, 2.0], [1.0, 0.9], [0.9, 1.0]], [[1.0, 1.0], [1.0, 1.0], [1.0, 1.0]]))
    assert choice.recommended == "pinhole"


def test_a_block_that_a_model_misses_altogether_is_no_noise():
    choice = choose(candidates([[1.0], [1.0], [1.0], [1.0], [400.0]], [[1.0]] * 5))
    assert choice.recommended == "brown_conrady"
    assert "too far to be left to the noise of a few blocks" in choice.why


def test_a_lower_error_of_the_smaller_model_needs_no_rule():
    choice = choose(candidates([[1.0, 1.0], [1.0, 1.0]], [[1.0, 1.1], [1.1, 1.0]]))
    assert choice.recommended == "pinhole"
    assert choice.why.startswith(
        "pinhole has the lowest mean error on held-out pairs: 1.00 px; brown_conrady is 0.05"
    )


def test_models_without_held_out_pairs_or_with_different_ones():
    none = {name: Candidate(one.free_parameters, one.fitted_mean_px, {}) for name, one in candidates([], []).items()}
    assert choose(none).recommended == "brown_conrady"
    assert "None were held out" in choose(none).why
    other = candidates([[1.0, 1.0], [1.0, 1.0]], [[1.0, 1.0], [1.0]])
    assert choose(other).recommended is None and "cannot be compared" in choose(other).why


def held_out(problem, start):
    """The model's errors on each of five blocks under the fit to the others, from near its optimum."""
    model, lens = problem.model, len(INTRINSICS[problem.model])
    start = np.concatenate([start[:10], np.zeros(lens - 4)]) if len(start) != 6 + lens else start
    best = polish(problem, start).parameters
    found = {}
    for fold, block in enumerate(folds(np.arange(len(problem.points)), 5)):
        kept = np.setdiff1d(np.arange(len(problem.points)), block)
        document = {"model": model, "image_size": SIZE, "nominal": NOMINAL}
        reduced = problem_from_document(document, problem.points[kept], problem.pixels[kept])
        p = np.array(polish(reduced, best).parameters)
        errors = distances(problem, p)
        found[fold] = {int(pair): float(errors[pair]) for pair in block}
    return Candidate(6 + lens, 0.0, found)


@pytest.mark.parametrize("truth", ["pinhole", "brown_conrady"])
def test_the_true_model_is_recommended_on_simulated_rigs(truth):
    """Of six rigs; with the lowest held-out error alone, a larger model wins on one pinhole rig in seven."""
    wrong = 0
    for seed in range(6):
        problem, parameters = simulated(truth, 500 + seed)
        order = np.argsort(problem.points[:, 1] / problem.points[:, 0])
        models = {}
        for model in ("pinhole", "brown_conrady"):
            document = {"model": model, "image_size": SIZE, "nominal": NOMINAL}
            one = problem_from_document(document, problem.points[order], problem.pixels[order])
            start = parameters if model == truth else parameters[:10]
            models[model] = held_out(one, start)
        wrong += choose(models).recommended != truth
    assert wrong == 0
