"""What a result's deviations become where other models predict held-out pairs as well: those of the models' mixture.

A fit's deviations hold if its model is right. Bayesian model averaging (Hoeting and others 1999) has a peak for each
model, so that an interval is a quantile of the mixture, not a multiple of its deviation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.camera_models import parse_model
from apexcal.documents.precision import Prediction
from apexcal.documents.results import FitResult
from apexcal.documents.summaries import BetweenModels
from apexcal.geometry.result_differences import MOUNT, TURNS, difference
from apexcal.geometry.se3 import from_document
from workers.geometry.projection import NO_RAY_PX, project, unproject

# scipy publishes no types.
_normal: Callable[[NDArray[np.float64]], NDArray[np.float64]] = special.ndtr
_SIGMAS95: Final = 1.959963984540054
_HALVINGS: Final = 50
# A difference of so many stated deviations is more than a result's own noise.
_SURPRISE: Final = 2.0


class _Peak(NamedTuple):
    """A model's share, how far its parameter lies from the result's, and its own deviation and half-width."""

    share: float
    apart: float
    std: float
    half_width: float


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
    peaks = {name: _peaks(name, model, results, shares, apart) for name in own.std}
    return BetweenModels(
        weights=shares,
        std={name: None if mixture is None else _deviation(mixture) for name, mixture in peaks.items()},
        interval95_half_width={
            name: None if mixture is None else _half_width95(mixture) for name, mixture in peaks.items()
        },
        prediction=_prediction(model, results, shares),
    )


def _peaks(
    parameter: str,
    model: str,
    results: Mapping[str, FitResult],
    shares: Mapping[str, float],
    apart: Mapping[str, Mapping[str, float]],
) -> list[_Peak] | None:
    """The parameter's peaks; a model that lacks it or leaves it open counts as the result. None where it is open."""
    std = results[model].std.get(parameter)
    if std is None:
        return None
    half_width = results[model].interval95_half_width.get(parameter) or _SIGMAS95 * std
    return [
        _Peak(
            share,
            apart[name].get(parameter, 0.0),
            results[name].std.get(parameter) or std,
            results[name].interval95_half_width.get(parameter) or half_width,
        )
        for name, share in shares.items()
    ]


def _deviation(peaks: Sequence[_Peak]) -> float:
    """Root of the mixture's second moment about the result."""
    return float(np.sqrt(sum(peak.share * (peak.std**2 + peak.apart**2) for peak in peaks)))


def _half_width95(peaks: Sequence[_Peak]) -> float:
    """h with 0.95 of the mixture within h of the result; a peak is the Gaussian of its own interval."""
    share, apart, _, half_width = np.array(peaks).T
    deviation = np.maximum(half_width / _SIGMAS95, 1e-300)
    low, high = 0.0, float(np.max(np.abs(apart) + 2.0 * half_width))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = share @ (_normal((middle - apart) / deviation) - _normal((-middle - apart) / deviation))
        low, high = (middle, high) if inside < 0.95 else (low, middle)
    return high


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
