"""Deviations of a mixture of models, for a result beside which other models predict held-out pairs as well.

A fit's deviations hold if its model is right. Bayesian model averaging (Hoeting and others 1999) has a peak for each
model. One covariance has the spread of the peaks; deviations are its roots, and an interval is a quantile of the
mixture, never below the deviation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.camera_models import parse_model
from apexcal.documents.precision import Covariance, Prediction
from apexcal.documents.results import FitResult
from apexcal.documents.summaries import BetweenModels
from apexcal.geometry.result_differences import MOUNT, TURNS, difference
from apexcal.geometry.se3 import from_document
from workers.geometry.projection import NO_RAY_PX, project, unproject

# scipy publishes no types.
_normal: Callable[[NDArray[np.float64]], NDArray[np.float64]] = special.ndtr
_SIGMAS95: Final = 1.959963984540054
_HALVINGS: Final = 50
# Stated deviations beyond which a difference is more than a result's own noise.
_SURPRISE: Final = 2.0


def spread_of(model: str, results: Mapping[str, FitResult], weight: Mapping[str, float]) -> BetweenModels | None:
    """The mixture's deviations and intervals about ``model``, by parameter; None where there is no other model.

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
    shares = {name: share / whole for name, share in weights.items()}
    apart = {name: difference(results[name], own) for name in shares}
    added = {name: sum(share * apart[each].get(name, 0.0) ** 2 for each, share in shares.items()) for name in own.std}
    std = {
        name: None if value is None else float(np.hypot(value, np.sqrt(added[name])))
        for name, value in own.std.items()
    }
    return BetweenModels(
        weights=shares,
        std=std,
        interval95_half_width={
            name: None if value is None else _half_width95(name, value, own, shares, apart)
            for name, value in std.items()
        },
        covariance=_covariance(own, shares, apart),
        prediction=_prediction(model, results, shares),
    )


def _covariance(own: FitResult, shares: Mapping[str, float], apart: Mapping[str, Mapping[str, float]]) -> Covariance:
    """The mixture's second moments about the result, people's units.

    Models share mount, focal lengths and centre alone: a coefficient of another model has another meaning.
    """
    names = own.covariance.names
    matrix = np.array(own.covariance.matrix, np.float64)
    for model, share in shares.items():
        off = np.array([apart[model].get(name, 0.0) for name in names])
        matrix = matrix + share * np.outer(off, off)
    return own.covariance.model_copy(update={"matrix": matrix.tolist()})


def _half_width95(
    name: str, std: float, own: FitResult, shares: Mapping[str, float], apart: Mapping[str, Mapping[str, float]]
) -> float:
    """h with 0.95 of the mixture within h of the result, each peak the Gaussian of the result's own interval.

    At least the deviation, in which an unlikely model that is far off counts.
    """
    half_width = own.interval95_half_width.get(name) or _SIGMAS95 * std
    share = np.array(list(shares.values()))
    off = np.array([apart[model].get(name, 0.0) for model in shares])
    deviation = max(half_width / _SIGMAS95, 1e-300)
    low, high = 0.0, float(np.max(np.abs(off)) + 2.0 * half_width)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = share @ (_normal((middle - off) / deviation) - _normal((-middle - off) / deviation))
        low, high = (middle, high) if inside < 0.95 else (low, middle)
    return max(high, std)


def _prediction(model: str, results: Mapping[str, FitResult], shares: Mapping[str, float]) -> Prediction | None:
    """The mixture's deviations of projected points; a model that has no ray there counts as the result."""
    own = results[model].prediction
    if own is None:
        return None
    squares = np.zeros((2, len(own.points), len(own.distances_m)))
    for name, share in shares.items():
        apart = _points_apart(results[name], results[model], own)
        stated = _stated(results[name].prediction or own)
        stated = np.where(np.isnan(apart) | np.isnan(stated), _stated(own), stated)
        squares += share * (stated**2 + np.nan_to_num(apart) ** 2)
    px, mm = np.sqrt(squares).tolist()
    points = [
        point.model_copy(update={"stated_px": px[row], "stated_mm": mm[row]}) if point.stated_px else point
        for row, point in enumerate(own.points)
    ]
    return own.model_copy(update={"points": points})


def _stated(prediction: Prediction) -> NDArray[np.float64]:
    """(2, points, distances) deviations, px and mm; nan where the lens has no ray."""
    none = [np.nan] * len(prediction.distances_m)
    points = prediction.points
    return np.array([[point.stated_px or none for point in points], [point.stated_mm or none for point in points]])


def _points_apart(result: FitResult, own: FitResult, prediction: Prediction) -> NDArray[np.float64]:
    """(2, points, distances): how far the result puts the points from their pixels, px, and their rays, mm."""
    pixels = np.array([[point.u, point.v] for point in prediction.points])
    distances = np.array(prediction.distances_m)
    mount, other_mount = (from_document(each.transform) for each in (own, result))
    lens, other_lens = own.intrinsics, result.intrinsics
    rays, _ = unproject(parse_model(lens.model), lens.by_name(), pixels)
    other_rays, miss = unproject(parse_model(other_lens.model), other_lens.by_name(), pixels)
    other_rays[miss >= NO_RAY_PX] = np.nan
    there = (rays[:, None] * distances[:, None]).reshape(-1, 3)
    points = other_mount.apply(mount.inverse().apply(there))
    projected, violation = project(parse_model(other_lens.model), other_lens.by_name(), points)
    projected[violation > 0.0] = np.nan
    px = np.linalg.norm(projected - np.repeat(pixels, len(distances), axis=0), axis=1)
    # From the own ray at that distance to where the other model has the pixel, without the part along the ray.
    other_points = (other_rays[:, None] * distances[:, None]).reshape(-1, 3)
    moved = mount.apply(other_mount.inverse().apply(other_points)) - there
    along = np.repeat(rays, len(distances), axis=0)
    across = moved - np.sum(moved * along, axis=1, keepdims=True) * along
    apart = np.stack([px, 1e3 * np.linalg.norm(across, axis=1)])
    # Both or none.
    apart[:, np.isnan(apart).any(axis=0)] = np.nan
    return apart.reshape(2, len(pixels), len(distances))


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
