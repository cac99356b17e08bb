"""A result's lens and mount as the overlay looks through them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.se3 import from_document
from workers.geometry.models import INTRINSICS, parse_model
from workers.geometry.projection import project
from workers.overlays.visible import Floats, See


def camera_of(intrinsics: Mapping[str, Any], transform: Mapping[str, Any]) -> See:
    """Raises :class:`GeometryError`: not a lens or a transform.

    Args:
        intrinsics: ``model`` and its parameters by name, as results state them.
        transform: T_camera_lidar as documents state it.
    """
    model = parse_model(intrinsics["model"])
    lens = np.array([intrinsics.get(name) or 0.0 for name in INTRINSICS[model]], np.float64)
    mount = from_document(transform)

    def see(points: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        in_camera = mount.apply(points)
        pixels, violation = project(model, lens, in_camera)
        return pixels, np.linalg.norm(in_camera, axis=1), violation == 0.0

    return see
