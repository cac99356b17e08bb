"""The summary of a camera: its models side by side, and which one is recommended and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final, NamedTuple
from uuid import UUID

import numpy as np

from apexcal.documents.camera_models import CAMERA_MODELS, parse_model
from workers.models.choice import Candidate, Choice, choose
from workers.models.evidence import Pairs
from workers.models.spread import spread_of, spread_sentence

Json = dict[str, Any]

# A missing projection counts in the mean as this share of the image's diagonal, or as the largest error, if that is
# more. The robust loss of the search saturates at this distance.
_NO_PROJECTION: Final = 0.01
_STAGES: Final = ("ga", "polished", "baseline", "linear_baseline")


class Fit(NamedTuple):
    """A result of one camera. ``heldout_fold`` is None for a fit to all pairs; ``document`` is the solver's."""

    result_id: UUID
    model: str
    heldout_fold: int | None
    document: Json
    search_seconds: float = 0.0
    workers: Sequence[str] = ()


def camera_summary(fits: Sequence[Fit]) -> Json:
    """Return the summary of one camera's fits."""
    choice, candidates = recommend(fits)
    full = {fit.model: fit for fit in fits if fit.heldout_fold is None}
    documents = {name: fit.document for name, fit in full.items()}
    wrong = _left_out_by_all(documents)
    models: dict[str, Json] = {}
    for name, fit in full.items():
        found = models[name] = _model_summary(fit)
        found |= _heldout(candidates[name].heldout, wrong, float(np.hypot(*fit.document["intrinsics"]["image_size"])))
        if name in choice.behind:
            found["behind"] = asdict(choice.behind[name])
        if name in choice.weight:
            found["weight"], found["heldout_sigma_px"] = choice.weight[name], choice.sigma_px[name]
        found["between_models"] = spread_of(name, documents, choice.weight)
    chosen = choice.recommended
    sentence = spread_sentence(chosen, documents, models[chosen]["between_models"]) if chosen else None
    return {"recommended": chosen, "why": f"{choice.why} {sentence or ''}".strip(), "models": models}


def recommend(fits: Sequence[Fit]) -> tuple[Choice, dict[str, Candidate]]:
    """Choose the model to recommend from a camera's fits, and say why."""
    full = {fit.model: fit.document for fit in fits if fit.heldout_fold is None}
    folds: dict[str, dict[int, Json]] = {name: {} for name in full}
    for fit in fits:
        if fit.heldout_fold is not None and fit.model in full and fit.document.get("heldout"):
            folds[fit.model][fit.heldout_fold] = fit.document
    candidates = {name: _candidate(name, document, folds[name]) for name, document in full.items()}
    width, height = next(iter(full.values()))["intrinsics"]["image_size"]
    return choose(candidates, float(width * height)), candidates


def _candidate(name: str, full: Json, folds: Mapping[int, Json]) -> Candidate:
    determined = {fold: one for fold, one in folds.items() if one["status"] != "not_determined"}
    # If most folds leave a model open, the others cannot judge it.
    judged = determined if 2 * len(determined) > len(folds) else {}
    parts = [_pairs(judged[fold]["heldout"]) for fold in sorted(judged)]
    residuals = np.array(full.get("residuals_px") or [full["polished"]["mean_px"]], np.float64)
    order = np.arange(len(residuals))
    return Candidate(
        free_parameters=full["free_parameters"],
        parameters=len(CAMERA_MODELS[parse_model(name)].intrinsics),
        fitted=Pairs(order, order, residuals, np.ones(len(order)), residuals),
        heldout=_joined(parts) if any(len(part.number) for part in parts) else None,
        at_bounds=full["at_bounds"],
        sound=full["status"] != "not_determined",
        undetermined=len(folds) - len(determined),
    )


def _pairs(heldout: Json) -> Pairs:
    """The pairs of a held-out fold."""
    number, block = (np.array(heldout[name], np.int64) for name in ("indices", "blocks"))
    return Pairs(
        number, block, *(np.array(heldout[name], np.float64) for name in ("standard_px", "stretch", "errors_px"))
    )


def _joined(parts: Sequence[Pairs]) -> Pairs:
    whole = Pairs(*(np.concatenate([getattr(part, name) for part in parts]) for name in Pairs.__dataclass_fields__))
    # Workers of two versions may have cut a model's folds differently: a pair counts once.
    _, order = np.unique(whole.number, return_index=True)
    return Pairs(*(getattr(whole, name)[order] for name in Pairs.__dataclass_fields__))


def _left_out_by_all(documents: Mapping[str, Json]) -> set[int]:
    """Pairs that every model's fit left out as outliers. Pairs that only some leave out count: they may show that a
    model lacks the lens.
    """
    left_out = [
        {outlier["index"] for outlier in document["outliers"] if outlier["excluded"]}
        for document in documents.values()
    ]
    return set.intersection(*left_out) if left_out else set()


def _heldout(pairs: Pairs | None, wrong: set[int], diagonal_px: float) -> Json:
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


def _model_summary(fit: Fit) -> Json:
    document = fit.document
    summary: Json = {stage: _stage(document[stage]) for stage in _STAGES}
    return summary | {
        "result_id": str(fit.result_id),
        "status": document["status"],
        "message": document["message"],
        "free_parameters": document["free_parameters"],
        "at_bounds": document["at_bounds"],
        "lens": document["lens"],
        "stated_lens": (document["stated_lens"] or {}).get("sentence"),
        "explained_px": document["explained_px"],
        "marks_outside": document["marks_outside"],
        "pairs": document["pairs"],
        "iterations": document["iterations"],
        "stopped": document["stopped"],
        "seconds": fit.search_seconds + document.get("finish_seconds", 0.0),
        "workers": list(fit.workers),
    }


def _stage(stage: Json | None) -> Json | None:
    return stage and {"mean_px": stage["mean_px"], "rms_px": stage["rms_px"]}
