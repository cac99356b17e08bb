"""A camera model as the kernels use it: one record, made in the model's own file.

Points are in the camera frame (optical axes: x right, y down, z forward, metres); pixels have (0, 0) at the centre
of the top-left pixel. A violation is 0 for a good projection, else a positive number that grows with how far the
point is from being one: behind the camera, or past the radius where the distortion stops growing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numba.core.types import CompileResultWAP
from numpy.typing import NDArray

from workers.geometry.linear_cameras import LinearStart
from workers.geometry.projections.single_precision import pointer_of

Floats = NDArray[np.float64]
Scalar = float | np.floating[Any]
Projected = tuple[Scalar, Scalar, Scalar]
"""u, v in pixels, and the violation."""

FUSED: Final = {"contract", "nsz", "arcp"}
"""Of one point: fused multiply-add is allowed; nothing that assumes finite numbers is."""


@dataclass(frozen=True, eq=False)
class Projection:
    """A camera model's projection, with all that follows from it. k (n,) are the intrinsics in their order.

    project_into: (k, points (N, 3), pixels (N, 2), violation (N,)) fills the last two; pixels are arbitrary where
        the violation is positive.
    jacobians_into: (k, points (N, 3), by_point (N, 2, 3), by_intrinsics (N, 2, n)) fills the last two.
    rays_into: (k, marks (N, 2), rays (N, 3)) fills rays, of unit length.
    fold_angle: (k) angle from the optical axis in radians up to which the model may be used.
    total_distances_into: (box, targets, population (F, P), totals (P,), first, stop (1,)) fills totals from `first`
        on with each individual's sum of weighted distances in px, in single precision (see `single_precision`). stop
        is looked at before each; where another thread has set it, the rest is left as it is.
    linear_start: the linear camera that least squares can start from.
    """

    project_into: Callable[[Floats, Floats, Floats, Floats], None]
    jacobians_into: Callable[[Floats, Floats, Floats, Floats], None]
    rays_into: Callable[[Floats, Floats, Floats], None]
    fold_angle: Callable[[Floats], float]
    total_distances_into: Any
    linear_start: LinearStart

    @cached_property
    def total_distances_pointer(self) -> CompileResultWAP:
        """`total_distances_into` as kernels take it as an argument: so they are compiled once for all models."""
        return pointer_of(self.total_distances_into)
