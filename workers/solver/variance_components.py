"""Variance components of errors that pairs share, by restricted maximum likelihood.

The errors of pairs i of one block b (a pose, or a stretch of time) are e_i = noise_i + sum over k of U_ik s_bk, with
noise of variance sigma^2 a coordinate and s_bk of variance tau_k^2 an axis, all independent (Patterson and Thompson
1971). Everything is computed from small sums over each block (Woodbury's identity), in time linear in the pairs.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
_MOST_STEPS: Final = 60
_HALVINGS: Final = 12
_ALONE: Final = 4
_LEAST_NOISE: Final = 1e-10  # of the residuals' mean square: what is left when blocks explain all else is rounding
_SETTLED: Final = 1e-6  # of the likelihood's logarithm: far below what changes any deviation


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
class Components:
    """What blocks share: labels (N,) of the blocks, from 0; shapes (N, 2, q), px per unit of what is shared;
    component (q,), the component k of each of the q columns.
    """

    labels: Indices
    shapes: Floats
    component: Indices


@dataclass(frozen=True, eq=False)
class Variances:
    """variances (1 + K,): sigma^2, tau_1^2, ...; information (1 + K, 1 + K): Fisher's; free (1 + K,): which variances
    are above zero.
    """

    variances: Floats
    information: Floats
    free: NDArray[np.bool_]


class _Sums(NamedTuple):
    # By block: U^T U (G, q, q), U^T J (G, q, F), U^T r (G, q); over all: J^T J, J^T r, r^T r, and the rows' number.
    S: Floats
    T: Floats
    w: Floats
    H: Floats
    j: Floats
    rr: float
    rows: int


class _Point(NamedTuple):
    likelihood: float
    score: Floats
    information: Floats


def variances_of(fit: Linearised, shared: Components) -> Variances:
    """The restricted maximum of the likelihood, by Fisher scoring with halved steps; no variance is below zero."""
    count = int(shared.component.max()) + 1
    sums = _sums(fit, shared)
    taken = len(fit.pull)
    theta = np.zeros(1 + count)
    theta[0] = sums.rr / max(sums.rows - taken, 1)
    least = _LEAST_NOISE * theta[0]
    # A third of the noise, shared out: any positive start will do.
    mean_square = [
        float(np.trace(sums.S[:, shared.component == k][:, :, shared.component == k].sum(0))) for k in range(count)
    ]
    # What moves no mark has no variance that pairs could tell.
    theta[1:] = [0.3 * theta[0] * sums.rows / square / count if square > 0.0 else 0.0 for square in mean_square]
    theta[0] *= 0.7
    here = _point(sums, fit, shared.component, theta)
    for _ in range(_MOST_STEPS):
        free = (theta > 0.0) | (here.score > 0.0)
        step = np.zeros_like(theta)
        step[free] = np.linalg.lstsq(here.information[np.ix_(free, free)], here.score[free], rcond=1e-12)[0]
        for _ in range(_HALVINGS):
            there = np.maximum(theta + step, 0.0)
            there[0] = max(there[0], 0.01 * theta[0], least)
            new = _point(sums, fit, shared.component, there)
            if new.likelihood >= here.likelihood:
                break
            step *= 0.5
        else:
            break
        gain, theta, here = new.likelihood - here.likelihood, there, new
        if gain < _SETTLED:
            break
    free = theta > 0.0
    return Variances(theta, here.information, free)


def uncertainty_of(estimate: Variances) -> Floats:
    """(1 + K, 1 + K) the covariance of the estimated variances; zero for those that are zero."""
    unsure = np.zeros_like(estimate.information)
    free = np.ix_(estimate.free, estimate.free)
    unsure[free] = np.linalg.pinv(estimate.information[free], hermitian=True)
    return unsure


def likelihood_ratio(fit: Linearised, shared: Components, estimate: Variances) -> float:
    """Twice the log ratio of the restricted likelihoods with shared and with independent errors."""
    sums = _sums(fit, shared)
    alone = np.zeros_like(estimate.variances)
    with_it = _point(sums, fit, shared.component, estimate.variances).likelihood
    # The noise that alone explains the residuals: its own likelihood has one maximum, here by Newton's method.
    alone[0] = sums.rr / max(sums.rows - len(fit.pull), 1)
    for _ in range(_ALONE):
        here = _point(sums, fit, shared.component, alone)
        alone[0] *= np.exp(np.clip(here.score[0] / (here.information[0, 0] * alone[0]), -1.0, 1.0))
    return max(0.0, 2.0 * float(with_it - _point(sums, fit, shared.component, alone).likelihood))


def _sums(fit: Linearised, shared: Components) -> _Sums:
    order = np.argsort(shared.labels, kind="stable")
    starts = np.flatnonzero(np.diff(shared.labels[order], prepend=-1))
    U, J, r = shared.shapes[order], fit.jacobian[order], fit.residuals[order]

    def by_block(values: Floats) -> Floats:
        return np.add.reduceat(values, starts, axis=0)

    flat = fit.jacobian.reshape(-1, fit.jacobian.shape[2])
    flat_r = fit.residuals.ravel()
    return _Sums(
        by_block(np.einsum("nci,ncj->nij", U, U)),
        by_block(np.einsum("nci,ncf->nif", U, J)),
        by_block(np.einsum("nci,nc->ni", U, r)),
        flat.T @ flat,
        flat.T @ flat_r,
        float(flat_r @ flat_r),
        2 * int(np.count_nonzero(np.any(fit.jacobian != 0.0, axis=(1, 2)))),
    )


class _Solved(NamedTuple):
    """The generalised least squares at some variances: V^-1 = (1 - U M U^T) / noise, C (F, F) their covariance, the
    step h (F,) to their optimum, the residuals there by block (U^T r: left (G, q)) and in squares.
    """

    noise: float
    inner: Floats
    M: Floats
    C: Floats
    h: Floats
    left: Floats
    squares: float


def _solved(sums: _Sums, fit: Linearised, component: Indices, theta: Floats) -> _Solved:
    noise = float(theta[0])
    root = np.sqrt(theta[1:][component] / noise)
    inner = np.eye(len(component)) + root[:, None] * sums.S * root
    M: Floats = root[:, None] * np.asarray(np.linalg.inv(inner), np.float64) * root
    normal = _within(sums.H, sums.T, M) / noise + fit.prior
    C = np.linalg.pinv(normal, rcond=1e-12, hermitian=True).astype(np.float64)
    h = C @ ((sums.j - np.einsum("gif,gij,gj->f", sums.T, M, sums.w)) / noise + fit.pull)
    squares = sums.rr - 2.0 * float(h @ sums.j) + float(h @ sums.H @ h)
    return _Solved(noise, inner, M, C, h, sums.w - sums.T @ h, squares)


def _point(sums: _Sums, fit: Linearised, component: Indices, theta: Floats) -> _Point:
    """Restricted log-likelihood, its gradient and Fisher's information at variances theta (1 + K,).

    With P = V^-1 - V^-1 J C J^T V^-1, C = (J^T V^-1 J + prior)^-1: the gradient is (|V_k P r|^2 - tr P V_k) / 2, and
    the information tr(P V_k P V_l) / 2 (Searle, Casella and McCulloch 1992, ch. 6).
    """
    at = _solved(sums, fit, component, theta)
    S, T, M, C, noise, rows = sums.S, sums.T, at.M, at.C, at.noise, sums.rows
    MS = M @ S
    # Powers of V^-1 between blocks' columns: V^-n = (1 - U M_n U^T) / noise^n.
    M2: Floats = 2.0 * M - MS @ M
    M3: Floats = 3.0 * M - 3.0 * MS @ M + MS @ MS @ M
    J2, J3 = _within(sums.H, T, M2) / noise**2, _within(sums.H, T, M3) / noise**3
    C2 = C @ J2
    square_of_P = (at.squares - np.einsum("gi,gij,gj->", at.left, M2, at.left)) / noise**2
    trace_P = (rows - np.einsum("gij,gji->", M, S)) / noise - np.sum(C * J2)
    trace_PP = (rows - np.einsum("gij,gji->", M2, S)) / noise**2 - 2.0 * np.sum(C * J3) + np.sum(C2 * C2.T)
    # U^T P U, U^T P P U and U^T P r of one block; of two blocks U^T P U is -B C B^T alone.
    SM = np.swapaxes(MS, 1, 2)
    A, B = (S - SM @ S) / noise, (T - SM @ T) / noise
    z = (at.left - np.einsum("gij,gj->gi", SM, at.left)) / noise
    CB = B @ C
    around = np.einsum("gif,gjf->gij", CB, (T - S @ M2 @ T) / noise**2)
    squared = (S - S @ M2 @ S) / noise**2 - around - np.swapaxes(around, 1, 2)
    squared = squared + np.einsum("gif,fh,gjh->gij", CB, J2, CB)
    between = np.einsum("gif,gjf->gij", CB, B)
    count = len(theta)
    score, information = np.zeros(count), np.zeros((count, count))
    score[0], information[0, 0] = 0.5 * (square_of_P - trace_P), 0.5 * trace_PP
    columns = [component == k for k in range(count - 1)]
    of_all = [C @ np.einsum("gif,gih->fh", B[:, of], B[:, of]) for of in columns]
    for k, of_k in enumerate(columns):
        own = (A - between)[:, of_k][:, :, of_k]
        score[1 + k] = 0.5 * (np.sum(z[:, of_k] ** 2) - np.einsum("gii->", own))
        information[0, 1 + k] = information[1 + k, 0] = 0.5 * np.einsum("gii->", squared[:, of_k][:, :, of_k])
        for m, of_m in enumerate(columns):
            a, b = A[:, of_k][:, :, of_m], between[:, of_k][:, :, of_m]
            information[1 + k, 1 + m] = 0.5 * (np.sum(a * a) - 2.0 * np.sum(a * b) + np.sum(of_all[k] * of_all[m].T))
    return _Point(_likelihood(sums, fit, at), score, information)


def _likelihood(sums: _Sums, fit: Linearised, at: _Solved) -> float:
    # The priors' part of the exponent depends on the variances through h alone.
    quadratic = (at.squares - float(np.einsum("gi,gij,gj->", at.left, at.M, at.left))) / at.noise
    quadratic += float(at.h @ fit.prior @ at.h) - 2.0 * float(at.h @ fit.pull)
    values = np.linalg.eigvalsh(at.C)
    log_C = float(np.sum(np.log(values[values > 1e-12 * values[-1]])))
    log_V = sums.rows * float(np.log(at.noise)) + float(np.sum(np.linalg.slogdet(at.inner)[1]))
    return -0.5 * (log_V - log_C + quadratic)


def _within(H: Floats, T: Floats, M: Floats) -> Floats:
    return H - T.reshape(-1, len(H)).T @ (M @ T).reshape(-1, len(H))
