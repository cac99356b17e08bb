# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""Errors that pairs share, and how large they are, by restricted maximum likelihood.

Pair i is off by noise of variance sigma^2 and by U_ik s_ik for each component k. s_ik has the variance tau_k^2 along
each axis. Within a label s_ik and s_jk correlate by exp(-|t_i - t_j| / T_k) (Ornstein and Uhlenbeck 1930), between
labels not at all. T is infinite for what the pairs of a group share. A Kalman filter whitens residuals and Jacobian
(Kalman 1960), in time linear in the pairs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import exp, inf, log, sqrt
from typing import Final, NamedTuple

import numpy as np
import scipy  # its subpackages are loaded by their first use
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
_LEAST: Final = 1e-4
"""Share of the noise's variance below which nothing is shared."""
_MOST: Final = 1e8  # times the noise: then nearly all is shared
_LONGEST: Final = 1.0 / 8.0
"""Share of the walk for which errors may last: the fit's own parameters do what lasts longer."""
_STARTS: Final = 4  # lengths of time to begin from
_STEP: Final = 0.02  # of the logarithms, for second differences
_FIRST_STEP: Final = 1e-6  # of the logarithms, for first differences
_ENDS: Final = 1e-7
"""Share of a likelihood of some hundreds that ends the search."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """A fit at its end, linearised: N pairs, F parameters.

    residuals (N, 2) and jacobian (N, 2, F) as they count in the fit, px; weights of zero have rows of zero.
    prior (F, F) the priors' inverse variances, pull (F,) that times how far the parameters lie from their means.
    """

    residuals: Floats
    jacobian: Floats
    prior: Floats
    pull: Floats


@dataclass(frozen=True, eq=False)
class Component:
    """A shared error: shapes (N, 2, q), px per unit; labels (N,) and moments (N,), s or places; lasts: T, alike."""

    shapes: Floats
    labels: Indices
    moments: Floats
    lasts: float = inf

    def gaps(self, order: Indices) -> Floats:
        """(N,) time of each pair since the one before it in that order (N,); inf if that one has another label."""
        labels, gaps = self.labels[order], np.abs(np.diff(self.moments[order], prepend=0.0))
        return np.where(np.diff(labels, prepend=labels[0] - 1) == 0, gaps, inf)

    def decay(self, order: Indices) -> Floats:
        """(N,) correlation of each pair with the one before it in that order (N,)."""
        gaps = self.gaps(order)
        return np.exp(-gaps / self.lasts) if self.lasts < inf else np.where(gaps < inf, 1.0, 0.0)

    def lasting(self, times: float) -> Component:
        """Return the component with its T multiplied by ``times``."""
        return replace(self, lasts=times * self.lasts)

    def product(self, rows: Floats) -> Floats:
        """(F, F): rows^T K rows of rows (N, 2, F), with K the component's covariance at a variance of one."""
        order = np.lexsort((self.moments, self.labels))
        along = np.einsum("nci,ncf->nif", self.shapes, rows)[order]
        return _product(self.decay(order), along)

    def lengths(self, used: NDArray[np.bool_]) -> tuple[float, float]:
        """The shortest and longest T that the used pairs (N,) can tell."""
        moments = np.unique(self.moments[used])
        longest = _LONGEST * float(moments[-1] - moments[0])
        return min(float(np.median(np.diff(moments))), longest), longest


class Shares(NamedTuple):
    """The likeliest sizes of what pairs share, and the logarithm of their likelihood.

    noise: sigma^2. components and variances (K,): with their T and tau^2. unsure (1 + K + L, 1 + K + L): covariance
    of the logarithms of sigma^2, the K variances and the L finite T; zero for what is at an end of its range.
    """

    likelihood: float
    noise: float
    components: tuple[Component, ...]
    variances: Floats
    unsure: Floats


def shares_of(fit: Linearised, components: Sequence[Component], noise: float) -> Shares:
    """Return the restricted maximum of the likelihood (Patterson and Thompson 1971); `noise`: about sigma^2, px^2.

    Labels and moments of a component lie whole within those of the next one. Uncertainties follow from the second
    derivatives of the likelihood.
    """
    used = np.any(fit.jacobian != 0.0, axis=(1, 2))
    sizes = np.array([max(float(np.mean(each.shapes[used] ** 2)), 1e-300) for each in components])
    lasting = [k for k, each in enumerate(components) if each.lasts < inf]
    ranges = [components[k].lengths(used) for k in lasting]
    count, pairs = 1 + len(components), int(np.count_nonzero(used))
    order = np.lexsort([key for each in components for key in (each.moments, each.labels)] or [np.arange(len(used))])
    rows = np.concatenate([fit.jacobian, fit.residuals[:, :, None]], axis=2)[order]
    shapes = np.concatenate([np.zeros((len(used), 2, 0)), *(each.shapes for each in components)], axis=2)[order]
    columns = np.repeat(np.arange(len(components)), [each.shapes.shape[2] for each in components])
    decays = np.array([each.decay(order) for each in components]).reshape(-1, len(used))
    gaps = [components[k].gaps(order) for k in lasting]

    # It does not depend on the noise, of which the variances are multiples.
    @cache
    def normal_equations(*logarithms: float) -> tuple[Floats, float]:
        for k, gap, last in zip(lasting, gaps, logarithms[count - 1 :], strict=True):
            decays[k] = np.exp(-gap / exp(last))
        variances = (np.exp(np.array(logarithms[: count - 1])) / sizes)[columns]
        return _normal_equations(decays[columns], variances, shapes, used[order], rows)

    def unlikely(x: Floats) -> float:
        log_noise, *logarithms = x.tolist()
        return _unlikely(*normal_equations(*logarithms), pairs, fit.prior, fit.pull, log_noise)

    def with_slope(x: Floats) -> tuple[float, Floats]:
        value = unlikely(x)
        steps = _FIRST_STEP * np.eye(len(x))
        return value, np.array([unlikely(x + step) - value for step in steps]) / _FIRST_STEP

    begin = np.log([0.7 * noise, *([0.3 / max(count - 1, 1)] * (count - 1))])
    starts = [
        np.concatenate([begin, [log(shortest) + share * log(longest / shortest) for shortest, longest in ranges]])
        for share in (np.arange(_STARTS) + 0.5) / _STARTS
    ]
    ends = np.log([(1e-10 * noise, 1e4 * noise), *([(_LEAST, _MOST)] * (count - 1)), *ranges])
    start = min(starts if lasting else starts[:1], key=unlikely)
    best = scipy.optimize.minimize(
        with_slope, start, jac=True, method="L-BFGS-B", bounds=ends, options={"ftol": _ENDS}
    )
    x = np.asarray(best.x, np.float64)
    free = np.flatnonzero((x > ends[:, 0] + _STEP) & (x < ends[:, 1] - _STEP))
    unsure = np.zeros((len(x), len(x)))
    unsure[np.ix_(free, free)] = np.linalg.pinv(_curvature(unlikely, x, free), rcond=1e-6, hermitian=True)
    # tau^2 is a multiple of sigma^2.
    mixed = np.eye(len(x))
    mixed[1:count, 0] = 1.0
    variances = np.where(x[1:count] > ends[1:count, 0] + _STEP, np.exp(x[0] + x[1:count]) / sizes, 0.0)
    fitted = list(components)
    for k, last in zip(lasting, x[count:].tolist(), strict=True):
        fitted[k] = components[k].lasting(float(np.exp(last)) / components[k].lasts)
    return Shares(-float(best.fun), float(np.exp(x[0])), tuple(fitted), variances, mixed @ unsure @ mixed.T)


def _curvature(function: Callable[[Floats], float], x: Floats, free: Indices) -> Floats:
    """(M, M) second differences of a function at x, along its free places (M,)."""
    steps = _STEP * np.eye(len(x))[free]
    curvature = np.empty((len(free), len(free)))
    for i, a in enumerate(steps):
        for j, b in enumerate(steps[: i + 1]):
            differences = function(x + a + b) - function(x + a - b) - function(x - a + b) + function(x - a - b)
            curvature[i, j] = curvature[j, i] = differences / (4.0 * _STEP**2)
    return curvature


@njit(nogil=True, error_model="numpy", cache=True)
def _product(decay: Floats, rows: Floats) -> Floats:
    # rows (N, q, F), correlated along N: each row against those before it, and the same the other way round.
    before = np.zeros(rows.shape[1:])
    total = np.zeros((rows.shape[2], rows.shape[2]))
    for i in range(rows.shape[0]):
        before *= decay[i]
        for k in range(rows.shape[1]):
            for f in range(rows.shape[2]):
                for g in range(rows.shape[2]):
                    total[f, g] += rows[i, k, f] * (before[k, g] + 0.5 * rows[i, k, g])
        before += rows[i]
    return total + total.T


@njit(nogil=True, error_model="numpy", cache=True)
def _whiten(decays: Floats, variances: Floats, shapes: Floats, used: NDArray[np.bool_], rows: Floats) -> float:
    """Whiten rows (N, 2, m) in place by 1 + U K U^T and return the logarithm of its determinant.

    State s (d,) of all components: decays (d, N), variances (d,), shapes (N, 2, d). Each pair's rows become their
    innovations, over these' deviations.
    """
    d, m = len(variances), rows.shape[2]
    P, state, PH, gain = np.zeros((d, d)), np.zeros((d, m)), np.empty((d, 2)), np.empty((d, 2))
    log_det = 0.0
    for i in range(rows.shape[0]):
        for a in range(d):
            for b in range(d):
                P[a, b] *= decays[a, i] * decays[b, i]
            P[a, a] += variances[a] * (1.0 - decays[a, i] ** 2)
            state[a] *= decays[a, i]
        if not used[i]:
            continue
        H = shapes[i]
        s00, s01, s11 = 1.0, 0.0, 1.0
        for a in range(d):
            PH[a] = 0.0
            for b in range(d):
                PH[a, 0] += P[a, b] * H[0, b]
                PH[a, 1] += P[a, b] * H[1, b]
            s00 += H[0, a] * PH[a, 0]
            s01 += H[1, a] * PH[a, 0]
            s11 += H[1, a] * PH[a, 1]
        l00 = sqrt(s00)
        l10 = s01 / l00
        l11 = sqrt(s11 - l10 * l10)
        log_det += 2.0 * log(l00 * l11)
        for a in range(d):
            gain[a, 0] = PH[a, 0] / l00
            gain[a, 1] = (PH[a, 1] - l10 * gain[a, 0]) / l11
        for k in range(m):
            u, v = rows[i, 0, k], rows[i, 1, k]
            for a in range(d):
                u -= H[0, a] * state[a, k]
                v -= H[1, a] * state[a, k]
            u /= l00
            v = (v - l10 * u) / l11
            rows[i, 0, k], rows[i, 1, k] = u, v
            for a in range(d):
                state[a, k] += gain[a, 0] * u + gain[a, 1] * v
        for a in range(d):
            for b in range(d):
                P[a, b] -= gain[a, 0] * gain[b, 0] + gain[a, 1] * gain[b, 1]
    return log_det


@njit(nogil=True, error_model="numpy", cache=True)
def _normal_equations(
    decays: Floats, variances: Floats, shapes: Floats, used: NDArray[np.bool_], rows: Floats
) -> tuple[Floats, float]:
    """The lower half (m, m) of W^T W of the whitened rows W, and the logarithm of `_whiten`."""
    white, m = rows.copy(), rows.shape[2]
    log_det = _whiten(decays, variances, shapes, used, white)
    G = np.zeros((m, m))
    for row in white.reshape(-1, m):
        for a in range(m):
            for b in range(a + 1):
                G[a, b] += row[a] * row[b]
    return G, log_det


@njit(nogil=True, error_model="numpy", cache=True)
def _unlikely(normal: Floats, log_det: float, count: int, prior: Floats, pull: Floats, log_noise: float) -> float:
    """The restricted likelihood's negative logarithm: of the priors' part only what depends on the variances.

    Of `count` pairs, by the normal equations (F + 1, F + 1) of Jacobian and residuals.
    """
    F = len(pull)
    G = normal / exp(log_noise)
    total = 0.5 * (2.0 * count * log_noise + log_det + G[F, F])
    # Cholesky's factor in place, without parameters that nothing determines beside the earlier ones.
    for a in range(F):
        G[F, a] += pull[a]
        for b in range(a + 1):
            G[a, b] += prior[a, b]
    for a in range(F):
        size = G[a, a]
        for b in range(a):
            G[a, a] -= G[a, b] * G[a, b]
        is_determined = G[a, a] > 1e-12 * size
        if is_determined:
            G[a, a] = sqrt(G[a, a])
            total += log(G[a, a])
        for c in range(a + 1, F + 1):
            for b in range(a):
                G[c, a] -= G[c, b] * G[a, b]
            G[c, a] = G[c, a] / G[a, a] if is_determined else 0.0
        total -= 0.5 * G[F, a] * G[F, a]
    return total
