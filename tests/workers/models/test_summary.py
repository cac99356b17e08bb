"""What a camera's fits come to, side by side."""

from uuid import uuid4

import pytest

from apexcal.documents.results import FitResult, Precision
from tests.support.results import fit_result, of_block
from workers.models.summary import CameraFit, camera_summary, recommend

BOTH = ("pinhole", "brown_conrady")
STATED = {
    "intrinsics": fit_result()["intrinsics"],
    "transform": fit_result()["transform"],
    "rms_px": 3.0,
    "free_lens_rms_px": 0.3,
    "sentence": "The stated lens is not this camera's.",
    **{name: fit_result()[name] for name in Precision.model_fields},
}


def fit(model, fold=None, errors=(), indices=None, mean_px=1.0, **members):
    """A fit to all pairs, or that of a fold with the errors of its held-out pairs, ten to a fold."""
    rows = range(10 * fold, 10 * fold + len(errors)) if indices is None and errors else indices
    held = of_block(errors, rows) if errors else None
    result = fit_result(model, mean_px, heldout=held, **members)
    return CameraFit(uuid4(), fold, FitResult.model_validate(result))


def test_models_whose_folds_differ_are_compared_pair_by_pair():
    cut = {"pinhole": ([0, 1], [2, 3, 4]), "brown_conrady": ([0, 2, 4], [1, 3])}
    fits = [
        fit(model, fold, [1.0] * len(held), held) for model, folds in cut.items() for fold, held in enumerate(folds)
    ]
    choice, candidates = recommend(fits + [fit(model) for model in cut])
    assert choice.recommended == "pinhole"
    assert [one.heldout.number.tolist() for one in candidates.values()] == [[0, 1, 2, 3, 4], [0, 1, 2, 3, 4]]


def test_a_model_of_which_nothing_was_held_out_is_not_judged():
    found = camera_summary([fit("pinhole", mean_px=5.0), fit("brown_conrady"), fit("pinhole", 0, [5.0, 6.0])])
    assert found.recommended == "pinhole"
    assert "brown_conrady was not judged: nothing was held out of it." in found.why


def test_a_fold_that_left_parameters_open_counts_for_no_model():
    folds = [fit(model, fold, [1.0] * 10) for model in BOTH for fold in range(3) if (model, fold) != (BOTH[1], 1)]
    wild = fit("brown_conrady", 1, [900.0] * 10, status="not_determined")
    brown = camera_summary([*(fit(model) for model in BOTH), *folds, wild]).models["brown_conrady"]
    assert (brown.heldout_mean_px, brown.weight) == (pytest.approx(1.0), pytest.approx(0.5))
    of_most = [one._replace(result=one.result.model_copy(update={"status": "not_determined"})) for one in folds[3:]]
    fits = [*(fit(model) for model in BOTH), *folds[:3], *of_most, wild]
    assert camera_summary(fits).models["brown_conrady"].heldout_mean_px is None


def test_a_free_lens_is_recommended_over_a_stated_one_only_where_the_pairs_contradict_that():
    """The free pinhole predicts held-out pairs far better: by chance of few pairs, or since the lens is another's."""
    better = [fit("pinhole", fold, [0.3] * 10) for fold in range(3)]
    worse = [fit("brown_conrady", fold, [1.5] * 10) for fold in range(3)]

    def chosen(explains):
        stated = STATED | {"explains": explains}
        full = fit("brown_conrady", lens="stated, refined", stated_lens=stated)
        return camera_summary([fit("pinhole", stated_lens=stated), full, *better, *worse])

    for explains in (True, None):
        summary = chosen(explains)
        assert summary.recommended == "brown_conrady" and "do not contradict the stated lens" in summary.why
        assert summary.models["brown_conrady"].between_models is None, "a lens of its own widens nothing"
    against = chosen(False)
    assert against.recommended == "pinhole" and against.why.startswith(STATED["sentence"])


def test_a_projection_that_is_none_costs_a_bounded_error():
    folds = [fit(model, fold, [1.0] * 10) for model in BOTH for fold in range(2) if (model, fold) != (BOTH[1], 0)]
    none = fit("brown_conrady", 0, [1.0] * 9 + [2300.0])
    brown = camera_summary([*(fit(model) for model in BOTH), *folds, none]).models["brown_conrady"]
    # A hundredth of the image's diagonal of 1600 px.
    assert (brown.heldout_forbidden, brown.heldout_mean_px) == (1, pytest.approx((19 * 1.0 + 16.0) / 20))
    assert brown.behind.log_likelihood < 25.0


def test_pairs_that_every_fit_left_out_are_not_held_against_any_model():
    wrong = {"residual_px": 500.0, "score": 99.0, "reason": "It is far off.", "excluded": True}
    fits = [
        fit(model, outliers=[wrong | {"index": index} for index in excluded])
        for model, excluded in zip(BOTH, ((3, 4), (4,)), strict=True)
    ]
    fits += [
        fit(model, fold, errors) for model in BOTH for fold, errors in ((0, [1.0] * 3 + [9.0, 500.0]), (1, [1.0] * 5))
    ]
    models = camera_summary(fits).models
    assert [models[name].heldout_pairs for name in BOTH] == [9, 9]
    assert models["brown_conrady"].heldout_mean_px == pytest.approx((8 * 1.0 + 9.0) / 9)
