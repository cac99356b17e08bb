"""Recommends the smallest camera model that is as likely as any on held-out pairs, and says why (decision 0045)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from apexcal.documents.summaries import Behind
from workers.models.evidence import Evidence, Pairs, evidence_of_models, standard_error

# Difference of log likelihoods below which models predict alike, and its standard error says little (Sivula,
# Magnusson and Vehtari 2020).
_ALIKE: Final = 4.0


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model as it was fitted.

    ``parameters``: all of the model, ``free_parameters``: those not locked. ``sound``: its fit to all
    pairs determines them. ``fitted`` are the errors of that fit, ``heldout`` those of the folds that determine the
    parameters, None where they are too few; ``undetermined`` counts the other folds.
    """

    free_parameters: int
    parameters: int
    fitted: Pairs
    heldout: Pairs | None
    at_bounds: Sequence[str] = ()
    sound: bool = True
    undetermined: int = 0


@dataclass(frozen=True)
class Choice:
    """The recommended model or none, the sentences that say why, and what the held-out pairs say of each model."""

    recommended: str | None
    why: str
    behind: dict[str, Behind] = field(default_factory=dict[str, Behind])
    weight: dict[str, float] = field(default_factory=dict[str, float])
    sigma_px: dict[str, float] = field(default_factory=dict[str, float])


def choose(models: Mapping[str, Candidate], area_px2: float) -> Choice:
    """Recommend one of a camera's models. ``area_px2``: the image's."""
    judged = {name: candidate.heldout for name, candidate in models.items() if candidate.heldout is not None}
    if not judged:
        return _by_fitted(models, area_px2)
    common = np.array(sorted(set.intersection(*(set(pairs.number.tolist()) for pairs in judged.values()))), np.int64)
    if not common.size:
        return Choice(
            None,
            "The models cannot be compared: no pair was held out of all of them, because of runs that failed or that "
            "leave parameters open.",
        )
    evidence = evidence_of_models({name: pairs.of(common) for name, pairs in judged.items()}, area_px2)
    return _by_heldout(models, {name: pairs.of(common) for name, pairs in judged.items()}, evidence)


def _by_heldout(models: Mapping[str, Candidate], judged: Mapping[str, Pairs], evidence: Evidence) -> Choice:
    behind = {name: _difference(name, judged, evidence) for name in judged if name != evidence.best}
    alike = [evidence.best, *(name for name, gap in behind.items() if gap.within_noise)]
    chosen = min(alike, key=lambda name: _rank(models[name], -evidence.total[name], name))
    others = sorted(behind, key=lambda name: (-evidence.total[name], name))
    sentences = [
        f"{evidence.best} fits held-out pairs best, to {evidence.sigma_px[evidence.best]:.2f} px per coordinate.",
        *(_behind(name, behind[name]) for name in others),
        *_because(chosen, evidence.best, models),
        *(_unjudged(name, candidate) for name, candidate in models.items() if name not in judged),
    ]
    return Choice(chosen, " ".join(sentences), behind, evidence.weight, evidence.sigma_px)


def _rank(model: Candidate, by_error: float, name: str) -> tuple[object, ...]:
    """Return the rank among models that predict alike: determined, inside its bounds, fewest parameters first."""
    return not model.sound, bool(model.at_bounds), model.free_parameters, model.parameters, by_error, name


def _difference(name: str, judged: Mapping[str, Pairs], evidence: Evidence) -> Behind:
    pairs, best = judged[name], judged[evidence.best]
    behind, deviation = evidence.behind(name, best.block)
    belonging = max(float(evidence.belongs.sum()), 1e-9)
    px = evidence.belongs * (pairs.errors_px - best.errors_px) / belonging
    lowest = max(float(evidence.belongs @ best.errors_px) / belonging, 1e-9)
    mean, of_mean = float(px.sum()), standard_error(px, best.block)
    return Behind(
        px=mean,
        standard_error_px=of_mean,
        percent=100 * mean / lowest,
        standard_error_percent=100 * of_mean / lowest,
        within_noise=behind < _ALIKE,
        log_likelihood=behind,
        standard_error_log_likelihood=deviation,
    )


def _behind(name: str, gap: Behind) -> str:
    words = f"{name} is {gap.px:+.2f} ± {gap.standard_error_px:.2f} px off against it"
    return f"{words}, which decides nothing." if gap.within_noise else f"{words}."


def _because(chosen: str, best: str, models: Mapping[str, Candidate]) -> list[str]:
    if chosen == best:
        return []
    first, other = models[chosen], models[best]
    if not other.sound:
        why = f"the pairs do not determine {best}"
    elif other.at_bounds and not first.at_bounds:
        why = f"{best} lies on the edge of its bounds ({', '.join(other.at_bounds)})"
    elif first.free_parameters != other.free_parameters:
        why = f"it has {first.free_parameters} free parameters instead of {other.free_parameters}"
    else:
        why = f"it has {first.parameters} parameters instead of {other.parameters}, as many of them free"
    return [f"{chosen} predicts alike and is recommended: {why}."]


def _unjudged(name: str, model: Candidate) -> str:
    if model.undetermined:
        return (
            f"{name} was not judged: the pairs that remain leave its parameters open in {model.undetermined} folds."
        )
    return f"{name} was not judged: nothing was held out of it."


def _by_fitted(models: Mapping[str, Candidate], area_px2: float) -> Choice:
    """Choose without held-out pairs, by Schwarz's criterion (1978) on the errors of the fits."""
    evidence = evidence_of_models({name: candidate.fitted for name, candidate in models.items()}, area_px2)
    coordinates = 2.0 * len(evidence.belongs)
    cost = {
        name: candidate.free_parameters * float(np.log(coordinates)) - 2.0 * evidence.total[name]
        for name, candidate in models.items()
    }
    ranked = sorted(models, key=lambda name: (cost[name], models[name].parameters, name))
    alike = [name for name in ranked if cost[name] - cost[ranked[0]] < 2.0 * _ALIKE]
    chosen = min(alike, key=lambda name: _rank(models[name], cost[name], name))
    means = {name: float(candidate.fitted.errors_px.mean()) for name, candidate in models.items()}
    sentences = [
        f"{name} {means[name]:.2f} px with {models[name].free_parameters} free parameters" for name in ranked
    ]
    return Choice(
        chosen,
        f"None were held out. Errors on the fitted pairs were weighed against the number of parameters: "
        f"{'; '.join(sentences)}. A larger model always looks better on the pairs that it was fitted to.",
    )
