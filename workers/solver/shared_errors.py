"""Errors that the pairs of one block share: how large they are, and whether they count."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.precision import OverTime, SharedErrors
from workers.geometry.spherical import axes, to_spherical
from workers.solver.blocks import Blocks
from workers.solver.error_model import ErrorModel, weighed
from workers.solver.problem import FitProblem
from workers.solver.residuals import by_point
from workers.solver.stretches import with_stretches
from workers.solver.variance_components import (
    Components,
    likelihood_ratio,
    uncertainty_of,
    variances_of,
)

Floats = NDArray[np.float64]
_COUNTED: Final = 2.706
"""Twice the log likelihood ratio that independent errors exceed in one of twenty cases."""
_EXTENT_M: Final = 1e-3  # pairs of one pose nearer together than this tell nothing of its turn


class Shared(NamedTuple):
    """What blocks share; the errors with what of it counts; and with all of it, also if it is too small to count."""

    named: SharedErrors
    errors: ErrorModel
    wider: ErrorModel


def shared_errors(problem: FitProblem, p: Floats, model: ErrorModel) -> Shared | None:
    """What blocks of a whitened problem's pairs share at p (D,), beside `model`, the errors without it.

    Somebody declared that groups share errors, so these always count. Stretches of a walk are our guess: their shared
    errors count only if those of pairs or groups alone do not explain them. None if there are no blocks.
    """
    if problem.blocks is None:
        return None
    used = problem.weights > 0.0
    rows = np.flatnonzero(used)
    blocks = problem.blocks.taken(rows)
    count = int(blocks.labels.max()) + 1
    if not 1 < count < len(rows):
        return None
    components, names = _components(problem, p, _of_all(blocks.labels, used), used, blocks)
    fit = model.with_columns(model.common, 1.0).fit  # what all pairs share is no error of blocks
    fitted = variances_of(fit, components)
    evidence = likelihood_ratio(fit, components, fitted)
    for labels in blocks.shorter:
        # Errors last for as long as the residuals say.
        other, _ = _components(problem, p, _of_all(labels, used), used, blocks)
        variances = variances_of(fit, other)
        if (likelier := likelihood_ratio(fit, other, variances)) > evidence:
            components, fitted, evidence, count = other, variances, likelier, int(labels.max()) + 1
    noise = float(fitted.variances[0])
    wider = replace(
        model, noise=noise, shared=(components,), variances=fitted.variances[1:], unsure=uncertainty_of(fitted)
    )
    sizes = np.sqrt(fitted.variances[1:])
    if blocks.kind != "group":
        squares: Floats = np.sum(components.shapes[used] ** 2, axis=(1, 2))
        sizes = sizes * float(np.sqrt(0.5 * np.mean(squares)))
    deviations = {
        name: float(np.degrees(size) if name.endswith("_deg") else size)
        for name, size in zip(names, sizes.tolist(), strict=True)
    }
    counted = blocks.kind == "group" or evidence > _COUNTED
    widening = _widening(model, wider)
    named = SharedErrors(
        blocks=count,
        by=blocks.kind,
        deviations=deviations,
        noise_px=float(np.sqrt(noise)),
        evidence=evidence,
        counted=counted,
        widening=widening,
        over_time=None,
    )
    errors = wider if counted else model
    if blocks.stretches is None or not blocks.stretches.any():
        return Shared(named, errors, wider)
    shifts = _shifts(problem, _of_all(blocks.stretches, used))
    over, both = with_stretches(model, components, shifts)
    shift_px = float(np.sqrt(both.variances[-1]))
    stretches = int(blocks.stretches.max()) + 1
    over_time = OverTime(
        blocks=stretches,
        shift_px=shift_px,
        evidence=over,
        counted=over > _COUNTED,
        widening=_widening(wider, both),
    )
    return Shared(named.model_copy(update={"over_time": over_time}), both if over > _COUNTED else errors, both)


def _of_all(labels: NDArray[np.int64], used: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(N,) the labels of the used pairs; the others have weight zero, so that their label does not count."""
    whole = np.zeros(len(used), np.int64)
    whole[used] = labels
    return whole


def _shifts(problem: FitProblem, labels: NDArray[np.int64]) -> Components:
    """A shift (px) of the marks of a walk's stretch."""
    n = len(labels)
    return Components(labels, weighed(problem, np.tile(np.eye(2), (n, 1, 1))), np.zeros(2, np.int64))


def _components(
    problem: FitProblem, p: Floats, labels: NDArray[np.int64], used: NDArray[np.bool_], blocks: Blocks
) -> tuple[Components, list[str]]:
    """A pose's offset (m) and turn (rad) about its middle; or what marks or vertices of a time block share."""
    n = len(labels)
    moved = by_point(problem, p)
    if blocks.kind != "group":
        if problem.covariances is None or not np.any(problem.covariances.points):
            return _shifts(problem, labels), ["shift_px"]
        # What lasts is a share of the vertices' stated variance across the ray.
        variances = np.diagonal(to_spherical(problem.covariances.points, problem.points), axis1=1, axis2=2)
        across = axes(problem.points)[:, :, :2] * np.sqrt(np.maximum(variances[:, None, :2], 0.0))
        return Components(labels, weighed(problem, moved @ across), np.zeros(2, np.int64)), ["shift_px"]
    total = np.zeros((int(labels.max()) + 1, 4))
    np.add.at(total, labels[used], np.column_stack([problem.points[used], np.ones(int(used.sum()))]))
    x, y, z = (problem.points - (total[:, :3] / total[:, 3:])[labels]).T
    offset = weighed(problem, moved)
    if max(float(np.abs(axis[used]).max()) for axis in (x, y, z)) < _EXTENT_M:
        return Components(labels, offset, np.zeros(3, np.int64)), ["offset_m"]
    nought = np.zeros(n)
    # Columns: how the point moves with a turn about x, y and z.
    turned = np.stack([nought, z, -y, -z, nought, x, y, -x, nought], axis=1).reshape(n, 3, 3)
    both = np.concatenate([offset, weighed(problem, moved @ turned)], axis=2)
    return Components(labels, both, np.repeat([0, 1], 3)), ["offset_m", "turn_deg"]


def _widening(plain: ErrorModel, wider: ErrorModel) -> float:
    rows = plain.fit.jacobian.reshape(-1, len(plain.scale)) / plain.scale
    traces = [float(np.sum((rows @ model.covariance()) * rows)) for model in (wider, plain)]
    return float(np.sqrt(traces[0] / traces[1])) if traces[1] > 0.0 else 1.0
