"""What a result's deviations become where other models predict held-out pairs as well: the models' spread is added.

A fit's deviations hold if its model is right. To them this adds the other models' weighted second moment about the
fit: the between-model variance of Bayesian model averaging (Hoeting and others 1999).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from apexcal.documents.results import FitResult
from apexcal.documents.summaries import BetweenModels
from apexcal.geometry.result_differences import MOUNT, TURNS, difference

# A difference of so many stated deviations is more than a result's own noise.
_SURPRISE: Final = 2.0


def spread_of(model: str, results: Mapping[str, FitResult], weight: Mapping[str, float]) -> BetweenModels | None:
    """The deviations of ``model`` with the spread of the models added, by parameter; None where there is no other.

    ``results``: of fits to all pairs, by model. ``weight``: of the judged models. Models that the pairs do not
    determine take no part.
    """
    own = results[model]
    weights = {
        name: share
        for name, share in weight.items()
        if name in results and (name == model or results[name].status != "not_determined")
    }
    whole = sum(weights.values())
    # A model that the pairs do not determine may have all of the weight.
    if model not in weights or len(weights) < 2 or not own.std or whole <= 0.0:
        return None
    differences = {name: difference(results[name], own) for name in weights if name != model}
    added = {
        name: sum(weights[other] / whole * apart[name] ** 2 for other, apart in differences.items() if name in apart)
        for name in own.std
    }
    std = {
        name: None if value is None else float(np.hypot(value, added[name] ** 0.5)) for name, value in own.std.items()
    }
    widened = {name: wide / value for name, value in own.std.items() if value and (wide := std[name])}
    return BetweenModels(
        weights={name: share / whole for name, share in weights.items()},
        std=std,
        interval95_half_width={
            name: None if value is None else value * widened.get(name, 1.0)
            for name, value in own.interval95_half_width.items()
        },
    )


def spread_sentence(model: str, results: Mapping[str, FitResult], spread: BetweenModels | None) -> str | None:
    """A sentence, if a model that is not ruled out gives a mount that differs by more than is stated."""
    if spread is None:
        return None
    own = results[model]
    sentences: list[str] = []
    for name, share in sorted(spread.weights.items(), key=lambda item: -item[1]):
        if name == model or share < 0.01:
            continue
        apart = difference(results[name], own)
        sigmas = max((abs(apart[key]) / std for key in MOUNT if (std := own.std.get(key))), default=0.0)
        if sigmas > _SURPRISE:
            degrees = np.linalg.norm([apart[key] for key in TURNS])
            millimetres = 1000 * np.linalg.norm([apart[key] for key in MOUNT[3:]])
            sentences.append(
                f"{name} (weight {share:.2f}) puts the mount {degrees:.2f} degrees and {millimetres:.0f} mm from "
                f"where {model} does, {sigmas:.1f} deviations that {model} states"
            )
    if not sentences:
        return None
    return f"{'; '.join(sentences)}: the pairs do not rule that out, so the published deviations include it."
