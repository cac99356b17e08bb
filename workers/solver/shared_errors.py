"""Errors that pairs of a group, or near in time, share: how large they are, and whether they count."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.precision import OverTime, SharedErrors
from workers.geometry.spherical import axes, to_spherical
from workers.solver.blocks import Blocks
from workers.solver.correlation import Component, Shares, shares_of
from workers.solver.error_model import ErrorModel, weighed
from workers.solver.problem import FitProblem
from workers.solver.residuals import by_point

Floats = NDArray[np.float64]
Used = NDArray[np.bool_]
_COUNTED: Final = 2.706
"""Twice the log likelihood ratio that independent errors exceed in one of twenty cases."""
_EXTENT_M: Final = 1e-3  # pairs of one pose nearer together than this tell nothing of its turn


class Shared(NamedTuple):
    """Shared errors; the error model with those that count; and with all, also those too small to count."""

    named: SharedErrors
    errors: ErrorModel
    wider: ErrorModel


def own_noise(model: ErrorModel) -> ErrorModel:
    """The model with the noise that is left when what all pairs share is fitted beside the parameters."""
    return model.with_shares(shares_of(model.with_columns(model.common, 1.0).fit, (), model.noise))


def shared_errors(problem: FitProblem, p: Floats, model: ErrorModel) -> Shared | None:
    """Estimate the errors that a whitened problem's pairs share at p (D,); `model` has the errors without these.

    Somebody declared that groups share errors, so these always count. How long errors last is our guess: those that
    last count only if errors of pairs or groups alone do not explain them. None if there are no blocks.
    """
    blocks, used = problem.blocks, problem.weights > 0.0
    if blocks is None or not 1 < len(np.unique(blocks.labels[used])) < np.count_nonzero(used):
        return None
    fit = model.with_columns(model.common, 1.0).fit  # what all pairs share is no error of blocks
    groups = _of_groups(problem, p, used, blocks) if blocks.kind == "group" else {}
    alone = shares_of(fit, (), model.noise)
    of_groups = shares_of(fit, tuple(groups.values()), model.noise) if groups else alone
    errors = wider = model.with_shares(of_groups) if groups else model
    over_time = None
    if blocks.moments is not None:
        lasting = _lasting(problem, p, blocks.moments)
        both = shares_of(fit, (*groups.values(), lasting), of_groups.noise)
        wider = model.with_shares(both)
        over_time = _over_time(both, of_groups, used, _widening(errors, wider))
        errors = wider if over_time.counted else errors
    if groups:
        sizes = np.sqrt(of_groups.variances).tolist()
        deviations = {
            name: float(np.degrees(size) if name == "turn_deg" else size)
            for name, size in zip(groups, sizes, strict=True)
        }
        named = SharedErrors(
            blocks=len(np.unique(blocks.labels[used])),
            by="group",
            deviations=deviations,
            noise_px=float(np.sqrt(of_groups.noise)),
            evidence=max(0.0, 2.0 * (of_groups.likelihood - alone.likelihood)),
            counted=True,
            widening=_widening(model, model.with_shares(of_groups)),
            over_time=over_time,
        )
    else:
        assert over_time is not None  # blocks without groups have moments
        named = SharedErrors(
            **over_time.model_dump(exclude={"shift_px"}),
            by=blocks.kind,
            deviations={"shift_px": over_time.shift_px},
            noise_px=float(np.sqrt(wider.noise)),
            over_time=None,
        )
    return Shared(named, errors, wider)


def _over_time(both: Shares, without: Shares, used: Used, widening: float) -> OverTime:
    lasting = both.components[-1]
    moments = lasting.moments[used]
    squares: Floats = np.sum(lasting.shapes[used] ** 2, axis=(1, 2))
    evidence = max(0.0, 2.0 * (both.likelihood - without.likelihood))
    return OverTime(
        # As many independent ones tell their mean as well (Bayley and Hammersley 1946).
        blocks=max(1, round(float(moments.max() - moments.min()) / (2.0 * lasting.lasts))),
        shift_px=float(np.sqrt(0.5 * np.mean(squares) * both.variances[-1])),
        evidence=evidence,
        counted=evidence > _COUNTED,
        widening=widening,
    )


def _lasting(problem: FitProblem, p: Floats, moments: Floats) -> Component:
    """Return lasting errors: a share of the vertices' stated variance across the ray, or a shift of marks (px)."""
    shapes = np.tile(np.eye(2), (len(moments), 1, 1))
    if problem.covariances is not None and np.any(problem.covariances.points):
        variances = np.diagonal(to_spherical(problem.covariances.points, problem.points), axis1=1, axis2=2)
        across = axes(problem.points)[:, :, :2] * np.sqrt(np.maximum(variances[:, None, :2], 0.0))
        shapes = by_point(problem, p) @ across
    return Component(weighed(problem, shapes), np.zeros(len(moments), np.int64), moments, lasts=1.0)


def _of_groups(problem: FitProblem, p: Floats, used: Used, blocks: Blocks) -> dict[str, Component]:
    """A pose's offset (m), and its turn (rad) about its middle if it has an extent."""
    labels, n = blocks.labels, len(blocks.labels)
    total = np.zeros((int(labels.max()) + 1, 4))
    np.add.at(total, labels[used], np.column_stack([problem.points[used], np.ones(int(used.sum()))]))
    x, y, z = (problem.points - (total[:, :3] / np.maximum(total[:, 3:], 1.0))[labels]).T
    moved = by_point(problem, p)
    none = np.zeros(n)
    # Columns: how the point moves with a turn about x, y and z.
    turned = np.stack([none, z, -y, -z, none, x, y, -x, none], axis=1).reshape(n, 3, 3)
    shapes = {"offset_m": moved}
    if max(float(np.abs(axis[used]).max()) for axis in (x, y, z)) >= _EXTENT_M:
        shapes["turn_deg"] = moved @ turned
    moments = np.zeros(n) if blocks.moments is None else blocks.moments
    return {name: Component(weighed(problem, shape), labels, moments) for name, shape in shapes.items()}


def _widening(plain: ErrorModel, wider: ErrorModel) -> float:
    rows = plain.fit.jacobian.reshape(-1, len(plain.scale)) / plain.scale
    traces = [float(np.sum((rows @ model.covariance()) * rows)) for model in (wider, plain)]
    return float(np.sqrt(traces[0] / traces[1])) if traces[1] > 0.0 else 1.0
