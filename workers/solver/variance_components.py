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
_SETTLED: Final = 1e-6  # of the likelihood's logarithm: far below what changes any deviation


@dataclass(frozen=True, eq=False)
class Linearised:
    """A fit at its end, linearised: N pairs, F parameters.

    residuals (N, 2) and jacobian (N, 2, F) as they count in the fit, px; weights of zero have rows of zero.
    prior (F, F) the priors' inverse variances, pull (F,) that times how far the parameters lie from the priors' means.
    """

    residuals: Floats
    jacobian: Floats
    prior: Floats
    pull: Floats


@dataclass(frozen=True, eq=False)
class Components:
    """What blocks share: labels (N,) of the blocks, from 0; shapes (N, 2, q), px by unit of what is shared; of which
    component k each of the q columns is, (q,).
    """

    labels: Indices
    shapes: Floats
    component: Indices


@dataclass(frozen=True, eq=False)
class Variances:
    """variances (1 + K,): sigma^2, tau_1^2, ...; information (1 + K, 1 + K) about them, expected; free (1 + K,): which
    of them are above zero.
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
    """The restricted maximum of the likelihood, by Fisher scoring with steps halved; none below zero."""
    count = int(shared.component.max()) + 1
    sums = _sums(fit, shared)
    taken = len(fit.pull)
    theta = np.zeros(1 + count)
    theta[0] = sums.rr / max(sums.rows - taken, 1)
    # A third of the noise, shared out: any positive start will do.
    mean_square = [np.trace(sums.S[:, shared.component == k][:, :, shared.component == k].sum(0)) for k in range(count)]
    theta[1:] = [0.3 * theta[0] * sums.rows / max(float(square), 1e-300) / count for square in mean_square]
    theta[0] *= 0.7
    here = _point(sums, fit, shared.component, theta)
    for _ in range(_MOST_STEPS):
        free = (theta > 0.0) | (here.score > 0.0)
        step = np.zeros_like(theta)
        step[free] = np.linalg.lstsq(here.information[np.ix_(free, free)], here.score[free], rcond=1e-12)[0]
        for _ in range(_HALVINGS):
            there = np.maximum(theta + step, 0.0)
            there[0] = max(there[0], 0.01 * theta[0])
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


def likelihood_ratio(fit: Linearised, shared: Components, found: Variances) -> float:
    """Twice the logarithm of the restricted likelihood's ratio: with what is shared, to independent errors."""
    sums = _sums(fit, shared)
    alone = np.zeros_like(found.variances)
    with_it = _point(sums, fit, shared.component, found.variances).likelihood
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


def _point(sums: _Sums, fit: Linearised, component: Indices, theta: Floats) -> _Point:
    """Restricted log-likelihood, its gradient and Fisher's information at variances theta (1 + K,).

    With P = V^-1 - V^-1 J C J^T V^-1, C = (J^T V^-1 J + prior)^-1: the gradient is (|V_k P r|^2 - tr P V_k) / 2, and
    the information tr(P V_k P V_l) / 2 (Searle, Casella and McCulloch 1992, ch. 6).
    """
    noise = theta[0]
    root = np.sqrt(theta[1:][component] / noise)
    q = len(component)
    S, T, w = sums.S, sums.T, sums.w
    inner = np.eye(q) + root[:, None] * S * root
    M = root[:, None] * np.linalg.inv(inner) * root
    MS = M @ S
    # Powers of V^-1 between blocks' columns: V^-n = (1 - U M_n U^T) / noise^n.
    M2 = 2.0 * M - MS @ M
    M3 = 3.0 * M - 3.0 * MS @ M + MS @ MS @ M
    C = np.linalg.pinv(_within(sums.H, T, M) / noise + fit.prior, rcond=1e-12, hermitian=True)
    J2 = _within(sums.H, T, M2) / noise**2
    J3 = _within(sums.H, T, M3) / noise**3
    h = C @ ((sums.j - np.einsum("gif,gij,gj->f", T, M, w)) / noise + fit.pull)
    left = w - T @ h
    squares = sums.rr - 2.0 * h @ sums.j + h @ sums.H @ h
    SM = np.swapaxes(MS, 1, 2)
    A = (S - SM @ S) / noise
    B = (T - SM @ T) / noise
    z = (left - np.einsum("gij,gj->gi", SM, left)) / noise
    square_of_P = (squares - np.einsum("gi,gij,gj->", left, M2, left)) / noise**2
    rows = sums.rows
    trace_P = (rows - np.einsum("gij,gji->", M, S)) / noise - np.sum(C * J2)
    A2 = (S - S @ M2 @ S) / noise**2
    B2 = (T - S @ M2 @ T) / noise**2
    CB = B @ C
    around = np.einsum("gif,gjf->gij", CB, B2)
    PP = A2 - around - np.swapaxes(around, 1, 2) + np.einsum("gif,fh,gjh->gij", CB, J2, CB)
    C2 = C @ J2
    trace_PP = (rows - np.einsum("gij,gji->", M2, S)) / noise**2 - 2.0 * np.sum(C * J3) + np.sum(C2 * C2.T)
    own = A - np.einsum("gif,gjf->gij", CB, B)
    count = len(theta)
    score, information = np.zeros(count), np.zeros((count, count))
    score[0] = 0.5 * (square_of_P - trace_P)
    information[0, 0] = 0.5 * trace_PP
    sums_B = [np.einsum("gif,gih->fh", B[:, component == k], B[:, component == k]) for k in range(count - 1)]
    for k in range(count - 1):
        of_k = component == k
        score[1 + k] = 0.5 * (np.sum(z[:, of_k] ** 2) - np.einsum("gii->", own[:, of_k][:, :, of_k]))
        information[0, 1 + k] = information[1 + k, 0] = 0.5 * np.einsum("gii->", PP[:, of_k][:, :, of_k])
        for m in range(k + 1):
            of_m = component == m
            # Of different blocks only -B C B^T is left; of the same block A as well.
            a = A[:, of_k][:, :, of_m]
            b = np.einsum("gif,gjf->gij", CB[:, of_k], B[:, of_m])
            all_blocks = np.sum((C @ sums_B[k] @ C) * sums_B[m])
            information[1 + k, 1 + m] = information[1 + m, 1 + k] = 0.5 * (
                np.sum(a * a) - 2.0 * np.sum(a * b) + all_blocks
            )
    sign, log_inner = np.linalg.slogdet(inner)
    values = np.linalg.eigvalsh(C)
    log_C = float(np.sum(np.log(values[values > 1e-12 * values[-1]])))
    quadratic = (squares - np.einsum("gi,gij,gj->", left, M, left)) / noise
    # The priors' part of the exponent does not depend on theta but through h.
    quadratic += h @ fit.prior @ h - 2.0 * h @ fit.pull
    likelihood = -0.5 * (rows * np.log(noise) + float(np.sum(log_inner)) - log_C + float(quadratic))
    return _Point(likelihood, score, information)


def _within(H: Floats, T: Floats, M: Floats) -> Floats:
    return H - np.einsum("gif,gij,gjh->fh", T, M, T, optimize=True)
