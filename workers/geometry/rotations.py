"""Compiled rotations for the hot loops, and their derivatives."""

from math import cos, sin, sqrt

from numba import njit

Rows = tuple[float, float, float, float, float, float, float, float, float]


# Exact arithmetic is requested explicitly: numba lets a callee inherit its caller's fast-math flags, so that its bits
# would depend on which caller was compiled first.
@njit(nogil=True, error_model="numpy", fastmath=False)
def rows_from_vector(x: float, y: float, z: float) -> Rows:
    """exp((x, y, z)) as nine numbers, row by row (Rodrigues)."""
    square = x * x + y * y + z * z
    if square < 1e-8:
        a = 1.0 - square / 6.0  # sin(t) / t
        b = 0.5 - square / 24.0  # (1 - cos(t)) / t^2
    else:
        angle = sqrt(square)
        a = sin(angle) / angle
        half = sin(0.5 * angle)
        b = 2.0 * half * half / square
    return (
        1.0 - b * (y * y + z * z),
        b * x * y - a * z,
        b * x * z + a * y,
        b * x * y + a * z,
        1.0 - b * (x * x + z * z),
        b * y * z - a * x,
        b * x * z - a * y,
        b * y * z + a * x,
        1.0 - b * (x * x + y * y),
    )


@njit(nogil=True, error_model="numpy", fastmath=False)
def rows_from_euler(alpha: float, beta: float, gamma: float) -> Rows:
    """Rz(alpha) Ry(beta) Rx(gamma) as nine numbers, row by row."""
    ca, sa = cos(alpha), sin(alpha)
    cb, sb = cos(beta), sin(beta)
    cg, sg = cos(gamma), sin(gamma)
    return (
        ca * cb,
        ca * sb * sg - sa * cg,
        ca * sb * cg + sa * sg,
        sa * cb,
        sa * sb * sg + ca * cg,
        sa * sb * cg - ca * sg,
        -sb,
        cb * sg,
        cb * cg,
    )


@njit(nogil=True, error_model="numpy", forceinline=True)
def rotation_rows(form: int, a: float, b: float, c: float) -> Rows:
    """The search rotation of FORM_ID `form`, row by row: exp(w), or Rz(alpha) Ry(beta) Rx(gamma)."""
    if form == 0:
        return rows_from_vector(a, b, c)
    return rows_from_euler(a, b, c)


@njit(nogil=True, error_model="numpy", fastmath=False)
def axes_of_vector(x: float, y: float, z: float) -> Rows:
    """Left Jacobian of exp at (x, y, z), row by row: column i is the axis about which parameter i turns.

    d exp(w) p = (J dw) x (exp(w) p). Source: Barfoot, State Estimation for Robotics, eq. 7.77.
    """
    square = x * x + y * y + z * z
    if square < 1e-6:
        b = 0.5 - square / 24.0  # (1 - cos(t)) / t^2
        c = 1.0 / 6.0 - square / 120.0  # (t - sin(t)) / t^3
    else:
        angle = sqrt(square)
        half = sin(0.5 * angle)
        b = 2.0 * half * half / square
        c = (angle - sin(angle)) / (square * angle)
    return (
        1.0 - c * (y * y + z * z),
        c * x * y - b * z,
        c * x * z + b * y,
        c * x * y + b * z,
        1.0 - c * (x * x + z * z),
        c * y * z - b * x,
        c * x * z - b * y,
        c * y * z + b * x,
        1.0 - c * (x * x + y * y),
    )


@njit(nogil=True, error_model="numpy", fastmath=False)
def axes_of_euler(alpha: float, beta: float) -> Rows:
    """As `axes_of_vector` for zyx angles: the columns are e_z, Rz e_y and Rz Ry e_x."""
    ca, sa = cos(alpha), sin(alpha)
    cb, sb = cos(beta), sin(beta)
    return (0.0, -sa, ca * cb, 0.0, ca, sa * cb, 1.0, 0.0, -sb)
