"""What one individual of the genetic algorithm costs: compiled, single precision, vectorised over the pairs."""

from math import sqrt
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workers.geometry.camera_kernels import (
    brown_conrady_point,
    kannala_brandt_point,
    pinhole_point,
)
from workers.geometry.fold_radius import brown_conrady_fold, kannala_brandt_fold
from workers.geometry.rotations import rows_from_euler, rows_from_vector

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

# Sums may be reordered (vector lanes) and fused. Infinities and NaN keep their meaning, so no `fast`.
_VECTOR: Final = {"reassoc", "contract", "arcp", "nsz"}
_ONE: Final = np.float32(1.0)
_ZERO: Final = np.float32(0.0)
_WORST: Final = np.float32(3.0e38)


@njit(nogil=True, error_model="numpy", forceinline=True)
def rotation_rows(
    form: int, a: float, b: float, c: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """The search rotation of FORM_ID `form`, row by row: exp(w), or Rz(alpha) Ry(beta) Rx(gamma)."""
    if form == 0:
        return rows_from_vector(a, b, c)
    return rows_from_euler(a, b, c)


@njit(nogil=True, error_model="numpy", fastmath=_VECTOR, cache=True)
def _pinhole(p: Floats, form: int, pack: Singles, diagonal: np.float32, bend: np.float32) -> np.float32:
    R = rotation_rows(form, p[0], p[1], p[2])
    f_x, f_y, c_x, c_y = p[6], p[7], p[8], p[9]
    # The intrinsics go into the rows of K [R | t], so that a pair costs nine products and a division.
    a0, a1, a2 = (
        np.float32(f_x * R[0] + c_x * R[6]),
        np.float32(f_x * R[1] + c_x * R[7]),
        np.float32(f_x * R[2] + c_x * R[8]),
    )
    b0, b1, b2 = (
        np.float32(f_y * R[3] + c_y * R[6]),
        np.float32(f_y * R[4] + c_y * R[7]),
        np.float32(f_y * R[5] + c_y * R[8]),
    )
    z0, z1, z2 = np.float32(R[6]), np.float32(R[7]), np.float32(R[8])
    a3, b3, z3 = np.float32(f_x * p[3] + c_x * p[5]), np.float32(f_y * p[4] + c_y * p[5]), np.float32(p[5])
    X, Y, Z, U, V, W = pack[0], pack[1], pack[2], pack[3], pack[4], pack[5]
    total = _ZERO
    for i in range(pack.shape[1]):
        u, v, violation = pinhole_point(
            a0 * X[i] + a1 * Y[i] + a2 * Z[i] + a3,
            b0 * X[i] + b1 * Y[i] + b2 * Z[i] + b3,
            z0 * X[i] + z1 * Y[i] + z2 * Z[i] + z3,
            _ONE, _ONE, _ZERO, _ZERO,
        )  # fmt: skip
        du = u - U[i]
        dv = v - V[i]
        d = sqrt(du * du + dv * dv)
        d = diagonal + diagonal * violation if violation > _ZERO else d
        if bend > _ZERO:
            d = d / (_ONE + d * bend)
        total += W[i] * d
    return total


@njit(nogil=True, error_model="numpy", fastmath=_VECTOR, cache=True)
def _brown_conrady(p: Floats, form: int, pack: Singles, diagonal: np.float32, bend: np.float32) -> np.float32:
    R = rotation_rows(form, p[0], p[1], p[2])
    r0, r1, r2, r3 = np.float32(R[0]), np.float32(R[1]), np.float32(R[2]), np.float32(p[3])
    s0, s1, s2, s3 = np.float32(R[3]), np.float32(R[4]), np.float32(R[5]), np.float32(p[4])
    z0, z1, z2, z3 = np.float32(R[6]), np.float32(R[7]), np.float32(R[8]), np.float32(p[5])
    f_x, f_y, c_x, c_y = np.float32(p[6]), np.float32(p[7]), np.float32(p[8]), np.float32(p[9])
    skew, k1, k2, k3 = np.float32(p[10]), np.float32(p[11]), np.float32(p[12]), np.float32(p[13])
    k4, k5 = np.float32(p[14]), np.float32(p[15])
    fold = np.float32(brown_conrady_fold(p[11], p[12], p[15]))
    X, Y, Z, U, V, W = pack[0], pack[1], pack[2], pack[3], pack[4], pack[5]
    total = _ZERO
    for i in range(pack.shape[1]):
        u, v, violation = brown_conrady_point(
            r0 * X[i] + r1 * Y[i] + r2 * Z[i] + r3,
            s0 * X[i] + s1 * Y[i] + s2 * Z[i] + s3,
            z0 * X[i] + z1 * Y[i] + z2 * Z[i] + z3,
            f_x, f_y, c_x, c_y, skew, k1, k2, k3, k4, k5, fold,
        )  # fmt: skip
        du = u - U[i]
        dv = v - V[i]
        d = sqrt(du * du + dv * dv)
        d = diagonal + diagonal * violation if violation > _ZERO else d
        if bend > _ZERO:
            d = d / (_ONE + d * bend)
        total += W[i] * d
    return total


@njit(nogil=True, error_model="numpy", fastmath=_VECTOR, cache=True)
def _kannala_brandt(p: Floats, form: int, pack: Singles, diagonal: np.float32, bend: np.float32) -> np.float32:
    R = rotation_rows(form, p[0], p[1], p[2])
    r0, r1, r2, r3 = np.float32(R[0]), np.float32(R[1]), np.float32(R[2]), np.float32(p[3])
    s0, s1, s2, s3 = np.float32(R[3]), np.float32(R[4]), np.float32(R[5]), np.float32(p[4])
    z0, z1, z2, z3 = np.float32(R[6]), np.float32(R[7]), np.float32(R[8]), np.float32(p[5])
    f_x, f_y, c_x, c_y = np.float32(p[6]), np.float32(p[7]), np.float32(p[8]), np.float32(p[9])
    k1, k2, k3, k4 = np.float32(p[10]), np.float32(p[11]), np.float32(p[12]), np.float32(p[13])
    fold = np.float32(kannala_brandt_fold(p[10], p[11], p[12], p[13]))
    X, Y, Z, U, V, W = pack[0], pack[1], pack[2], pack[3], pack[4], pack[5]
    total = _ZERO
    for i in range(pack.shape[1]):
        u, v, violation = kannala_brandt_point(
            r0 * X[i] + r1 * Y[i] + r2 * Z[i] + r3,
            s0 * X[i] + s1 * Y[i] + s2 * Z[i] + s3,
            z0 * X[i] + z1 * Y[i] + z2 * Z[i] + z3,
            f_x, f_y, c_x, c_y, k1, k2, k3, k4, fold,
        )  # fmt: skip
        du = u - U[i]
        dv = v - V[i]
        d = sqrt(du * du + dv * dv)
        d = diagonal + diagonal * violation if violation > _ZERO else d
        if bend > _ZERO:
            d = d / (_ONE + d * bend)
        total += W[i] * d
    return total


@njit(nogil=True, error_model="numpy", cache=True)
def evaluate_population(
    model_id: int,
    form: int,
    pack: Singles,
    scales: Floats,
    base: Floats,
    free: NDArray[np.int64],
    lower: Floats,
    width: Floats,
    prior: Floats,
    population: Singles,
    losses: Singles,
    first: int,
    stop: NDArray[np.uint8],
) -> None:
    """Losses in pixels of the individuals from `first` on.

    pack (6, M) float32: rows x y z (m, turned by the nominal rotation) u v (px) weight, padded with weight 0.
    scales (4,): image diagonal in px, 1 / saturation in 1 / px (0: mean distance), 1 / sum of weights, prior's share.
    base (D,): the parameter vector with its locked values; population (F, P): the free ones as fractions of
    [lower, lower + width]; prior (2, D): mean and 1 / sigma (0 where there is none).
    stop (1,): looked at before each individual; where another thread has set it, the rest is left as it is.
    """
    p = base.copy()
    diagonal, bend = np.float32(scales[0]), np.float32(scales[1])
    for n in range(first, population.shape[1]):
        # The losses that are stored in between keep the compiler from reading the flag only once.
        if stop[0] != 0:
            return
        for j in range(free.shape[0]):
            p[free[j]] = lower[j] + width[j] * population[j, n]
        if model_id == 0:
            total = _pinhole(p, form, pack, diagonal, bend)
        elif model_id == 1:
            total = _brown_conrady(p, form, pack, diagonal, bend)
        else:
            total = _kannala_brandt(p, form, pack, diagonal, bend)
        loss = total * scales[2]
        if scales[3] > 0.0:
            for j in range(p.shape[0]):
                off = (p[j] - prior[0, j]) * prior[1, j]
                loss += scales[3] * off * off
        # Written so that NaN is the worst of all losses too.
        losses[n] = np.float32(loss) if loss < _WORST else _WORST
