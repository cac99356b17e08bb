"""The part of every model that the search's loss needs: distances in single precision, vectorised over the pairs."""

from math import sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit, types
from numba.core.types import CompileResultWAP

# Importing it teaches numba to take a compiled function as an argument.
from numba.experimental import function_type as _  # noqa: F401  # pyright: ignore[reportUnusedImport]
from numpy.typing import NDArray

from workers.geometry.rotations import rotation_rows

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Flag = NDArray[np.uint8]
Single = float | np.floating[Any]
Row = tuple[Single, Single, Single, Single]
VECTOR: Final = {"reassoc", "contract", "arcp", "nsz"}
"""Sums may be reordered (vector lanes) and fused. Infinities and NaN keep their meaning, so no `fast`."""
ONE = np.float32(1.0)
ZERO = np.float32(0.0)


class Box(NamedTuple):
    """The bounds in which individuals lie, by D parameters and F free ones.

    A parameter vector p has the three of the rotation, then t in metres, then the intrinsics. base (D,): p with its
    locked values. free (F,): indices of the others; an individual has their fractions of [lower, lower + width].
    """

    base: Floats
    free: NDArray[np.int64]
    lower: Floats
    width: Floats


class Targets(NamedTuple):
    """The pairs, and how a distance counts.

    form: FORM_ID of the rotation. pack (6, M) float32: rows x y z (metres, turned by the nominal rotation), u v
    (pixels) and weight, padded with weight 0. diagonal_px: of the image. bend: 1 / saturation in 1 / px, 0 for the
    plain distance.
    """

    form: int
    pack: Singles
    diagonal_px: np.float32
    bend: np.float32


@njit(nogil=True, error_model="numpy", forceinline=True)
def place_individual(
    free: NDArray[np.int64], lower: Floats, width: Floats, population: Singles, n: int, p: Floats
) -> None:
    """Fill the free ones of p (D,) with the parameters of individual n of population (F, P), see `Box`.

    The box comes in parts: each look into a tuple within a loop counts references.
    """
    for j in range(free.shape[0]):
        p[free[j]] = lower[j] + width[j] * population[j, n]


@njit(nogil=True, error_model="numpy", forceinline=True)
def mount_rows(p: Floats, form: int) -> tuple[Row, Row, Row]:
    """The rows of [R | t] in single precision."""
    R = rotation_rows(form, p[0], p[1], p[2])
    return (
        (np.float32(R[0]), np.float32(R[1]), np.float32(R[2]), np.float32(p[3])),
        (np.float32(R[3]), np.float32(R[4]), np.float32(R[5]), np.float32(p[4])),
        (np.float32(R[6]), np.float32(R[7]), np.float32(R[8]), np.float32(p[5])),
    )


@njit(nogil=True, error_model="numpy", fastmath=VECTOR, forceinline=True)
def distance_of(
    u: Single, v: Single, violation: Single, mark_u: Single, mark_v: Single, diagonal: Single, bend: Single
) -> Single:
    """Distance in px of a projection from its mark, as the loss counts it: d, or d / (1 + d / saturation)."""
    du = u - mark_u
    dv = v - mark_v
    d = sqrt(du * du + dv * dv)
    d = diagonal + diagonal * violation if violation > ZERO else d
    if bend > ZERO:
        d = d / (ONE + d * bend)
    return d


def _array(dtype: types.Type, dimensions: int) -> types.Array:
    return types.Array(dtype, dimensions, "C")


_D1, _I1 = _array(types.float64, 1), _array(types.int64, 1)
_S1, _S2 = _array(types.float32, 1), _array(types.float32, 2)
_SIGNATURE: Final = types.void(
    types.NamedTuple((_D1, _I1, _D1, _D1), Box),
    types.NamedTuple((types.int64, _S2, types.float32, types.float32), Targets),
    *(_S2, _S1, types.int64, _array(types.uint8, 1)),
)


def pointer_of(total_distances_into: Any) -> CompileResultWAP:
    """A model's compiled kernel in the form that another kernel takes as an argument."""
    return CompileResultWAP(total_distances_into.get_compile_result(_SIGNATURE))
