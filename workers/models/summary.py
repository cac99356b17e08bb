"""The summary of a camera: its models side by side, and which one is recommended and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple
from uuid import UUID

import numpy as np

from apexcal.documents.camera_models import CAMERA_MODELS, parse_model
from apexcal.documents.results import Errors, FitResult, HeldOut
from apexcal.documents.summaries import CameraSummary, ModelSummary
from workers.geometry.projection import image_diagonal_px
from workers.models.choice import Candidate, Choice, choose
from workers.models.evidence import Pairs
from workers.models.spread import spread_of, spread_sentence

# A missing projection counts in the mean as this share of the image's diagonal, or as the largest error, if that is
# more. The robust loss of the search saturates at this distance.
_NO_PROJECTION: Final = 0.01
# Members of a model's summary that are the result's own.
_OF_RESULT: Final = (
    *("status", "message", "free_parameters", "at_bounds", "lens", "pairs", "explained_px", "marks_outside"),
    *("iterations", "stopped"),
)


class CameraFit(NamedTuple):
    """A result of one camera. ``heldout_fold`` is None for a fit to all pairs."""

    result_id: UUID
    heldout_fold: int | None
    result: FitResult
    search_seconds: float = 0.0
    workers: Sequence[str] = ()


def camera_summary(fits: Sequence[CameraFit]) -> CameraSummary:
    """Return the summary of one camera's fits. Its results are not judged yet: it has no checks and no verdicts."""
    choice, candidates = recommend(fits)
    full = {fit.result.model: fit for fit in fits if fit.heldout_fold is None}
    results = {name: fit.result for name, fit in full.items()}
    wrong = _left_out_by_all(results)
    models = {
        name: ModelSummary(
            **{member: getattr(fit.result, member) for member in _OF_RESULT},
            **_heldout(candidates[name].heldout, wrong, image_diagonal_px(fit.result.intrinsics.image_size)),
            result_id=fit.result_id,
            polished=_errors(fit.result.polished),
            ga=_errors(fit.result.ga),
            baseline=fit.result.baseline and _errors(fit.result.baseline),
            linear_baseline=fit.result.linear_baseline and _errors(fit.result.linear_baseline),
            stated_lens=fit.result.stated_lens and fit.result.stated_lens.sentence,
            seconds=fit.search_seconds + (fit.result.finish_seconds or 0.0),
            workers=list(fit.workers),
            weight=choice.weight.get(name),
            heldout_sigma_px=choice.sigma_px.get(name),
            behind=choice.behind.get(name),
            between_models=spread_of(name, results, choice.weight),
            verdict=None,
            verdict_alone=None,
        )
        for name, fit in full.items()
    }
    chosen = choice.recommended
    sentence = spread_sentence(chosen, results, models[chosen].between_models) if chosen else None
    why = f"{choice.why} {sentence or ''}".strip()
    return CameraSummary(recommended=chosen, why=why, models=models, checks=[], published=None)


def recommend(fits: Sequence[CameraFit]) -> tuple[Choice, dict[str, Candidate]]:
    """Choose the model to recommend from a camera's fits, and say why."""
    full = {fit.result.model: fit.result for fit in fits if fit.heldout_fold is None}
    folds: dict[str, dict[int, FitResult]] = {name: {} for name in full}
    for fit in fits:
        if fit.heldout_fold is not None and fit.result.model in full:
            folds[fit.result.model][fit.heldout_fold] = fit.result
    candidates = {name: candidate_of(result, folds[name]) for name, result in full.items()}
    width, height = next(iter(full.values())).intrinsics.image_size
    area_px2 = float(width * height)
    of_stated = {name: result for name, result in full.items() if result.lens != "fitted"}
    others = [name for name in full if name not in of_stated]
    if not of_stated or not others:
        return choose(candidates, area_px2), candidates
    against = [fit.sentence for result in of_stated.values() if (fit := result.stated_lens) and fit.explains is False]
    if len(against) == len(of_stated):
        choice = choose(candidates, area_px2)
        why = f"{against[0]} So models with lenses of their own are compared. {choice.why}"
    else:
        choice = choose({name: candidates[name] for name in of_stated}, area_px2)
        other = " and ".join(others)
        why = f"{choice.why} The pairs do not contradict the stated lens, so lenses of {other} are not weighed."
    return replace(choice, why=why), candidates


def candidate_of(full: FitResult, folds: Mapping[int, FitResult]) -> Candidate:
    """A fit to all pairs with those of its folds, as they are compared with others."""
    determined = {fold: result.heldout for fold, result in sorted(folds.items()) if result.status != "not_determined"}
    # If most folds leave a model open, the others cannot judge it.
    judged = determined.values() if 2 * len(determined) > len(folds) else []
    parts = [_pairs(heldout) for heldout in judged if heldout]
    residuals = np.array(full.residuals_px, np.float64)
    order = np.arange(len(residuals))
    return Candidate(
        free_parameters=full.free_parameters,
        parameters=len(CAMERA_MODELS[parse_model(full.model)].intrinsics),
        fitted=Pairs(order, order, residuals, np.ones(len(order)), residuals),
        heldout=_joined(parts) if any(len(part.number) for part in parts) else None,
        at_bounds=full.at_bounds,
        sound=full.status != "not_determined",
        undetermined=len(folds) - len(determined),
    )


def _pairs(heldout: HeldOut) -> Pairs:
    """The pairs of a held-out fold."""
    number, block = np.array(heldout.indices, np.int64), np.array(heldout.blocks, np.int64)
    errors = (heldout.standard_px, heldout.stretch, heldout.errors_px)
    return Pairs(number, block, *(np.array(values, np.float64) for values in errors))


def _joined(parts: Sequence[Pairs]) -> Pairs:
    """The pairs of all folds by their numbers, because models may have other folds."""
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Pairs.__dataclass_fields__}
    order = np.argsort(columns["number"])
    return Pairs(**{name: values[order] for name, values in columns.items()})


def _left_out_by_all(results: Mapping[str, FitResult]) -> set[int]:
    """Pairs that every model's fit left out as outliers. Pairs that only some leave out count: they may show that a
    model lacks the lens.
    """
    left_out = [{outlier.index for outlier in result.outliers if outlier.excluded} for result in results.values()]
    return set.intersection(*left_out) if left_out else set()


def _heldout(pairs: Pairs | None, wrong: set[int], diagonal_px: float) -> dict[str, Any]:
    """Mean and root mean square error of held-out pairs, and how many of them have no projection."""
    if pairs is not None:
        pairs = pairs.of(np.setdiff1d(pairs.number, np.array(sorted(wrong), np.int64)))
    if pairs is None or not len(pairs.number):
        return {"heldout_mean_px": None, "heldout_rms_px": None, "heldout_pairs": 0, "heldout_forbidden": 0}
    errors = pairs.errors_px
    none = errors >= diagonal_px
    counted = np.where(none, max([_NO_PROJECTION * diagonal_px, *errors[~none]]), errors)
    return {
        "heldout_mean_px": float(counted.mean()),
        "heldout_rms_px": float(np.sqrt(np.mean(counted**2))),
        "heldout_pairs": len(errors),
        "heldout_forbidden": int(none.sum()),
    }


def _errors(stage: Errors) -> Errors:
    """Return the errors that all stages state, without their parameters."""
    return Errors(mean_px=stage.mean_px, rms_px=stage.rms_px)
