"""What the models that divide by the depth share."""

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
NEAREST_DEPTH_M: Final = 1e-3
"""Points less than this in front of the camera's plane count as behind it."""
FARTHEST_SCALE: Final = 1.0 / NEAREST_DEPTH_M


@njit(nogil=True, error_model="numpy", fastmath=False)
def perspective_rows(
    k: Floats,
    skew: float,
    place: tuple[float, float, float],
    bent: tuple[float, float],
    slopes: tuple[float, float, float],
    P: Floats,
    J: Floats,
) -> None:
    """Fill P (2, 3) by point, and of J (2, n) by intrinsics the columns of f and c.

    place: a = x / z, b = y / z and 1 / z. bent: a_d, b_d, what the distortion makes of a and b. slopes: d a_d / d a,
    d a_d / d b = d b_d / d a, d b_d / d b.
    """
    f_x, f_y = k[0], k[1]
    a, b, inverse_z = place
    a_d, b_d = bent
    aa, ab, bb = slopes
    J[0, 0] = a_d + skew * b_d
    J[1, 1] = b_d
    J[0, 2] = 1.0
    J[1, 3] = 1.0
    u_a, u_b = f_x * (aa + skew * ab), f_x * (ab + skew * bb)
    v_a, v_b = f_y * ab, f_y * bb
    P[0, 0], P[0, 1], P[0, 2] = u_a * inverse_z, u_b * inverse_z, -(u_a * a + u_b * b) * inverse_z
    P[1, 0], P[1, 1], P[1, 2] = v_a * inverse_z, v_b * inverse_z, -(v_a * a + v_b * b) * inverse_z
