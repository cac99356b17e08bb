"""A fit in this process, without a service: ``apexcal`` imports the workers here alone, when it is called."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from apexcal.printed_result import PrintedResult

# T_camera_lidar of an upright camera that looks along the LiDAR's x axis; z of the optical frame leads forwards.
_FORWARD = ((0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_ANY_MOUNT_DEG = 180.0
# Beyond this distance a board of a metre is narrower than the spacing of any sensor's returns. If half of the points
# lie farther away, they are not in metres.
_FARTHEST_MEDIAN_M = 150.0


def fit(
    points: ArrayLike,
    pixels: ArrayLike,
    image_size: Sequence[int],
    model: str = "brown_conrady",
    lens: Mapping[str, float] | tuple[ArrayLike, ArrayLike] | None = None,
    *,
    T_camera_lidar: ArrayLike | None = None,
    columns: Mapping[str, Sequence[Any]] | None = None,
    **request: Any,
) -> PrintedResult:
    """Fit a camera's mount and lens to pairs, as the service's workers do.

    Args:
        points: (N, 3) metres, LiDAR frame.
        pixels: (N, 2) the marks of these points; (0, 0) is the centre of the top left pixel.
        image_size: width and height, pixels.
        model: ``pinhole``, ``brown_conrady`` or ``kannala_brandt``.
        lens: the known lens, which is locked then: the model's parameters by name (``f_x``, ``f_y``, ``c_x``,
            ``c_y``, ``skew``, ``k1`` ...; those left out are 0), or (K, D) as OpenCV has them, K (3, 3), D at most as
            long as the model's. None: the lens is fitted, too.
        T_camera_lidar: (4, 4) the mount as drawn. The search goes 30 degrees about it, ``rotation_range_deg`` says
            otherwise. None: any mount.
        columns: further columns of the pairs, N values each: ``stamp_ns`` or ``group`` (pairs of one moment or
            pose), ``corner``, and with ``weights="covariances"`` ``sigma_azimuth_rad``, ``sigma_elevation_rad``,
            ``sigma_range_m``, ``sigma_px``.
        request: other arguments of :func:`apexcal.documents.fit_requests.fit_request`: ``preset``, ``loss``,
            ``outliers``, ``bounds``, ``locked``, ``priors``, ``mark_sigma_px``, ``schedule``, ``seed`` ...

    Raises:
        InputError: the arguments allow no fit, for example too few pairs for the model, points in millimetres, or an
            image size as (height, width).

    >>> result = apexcal.fit(points, pixels, (1920, 1200), model="pinhole")
    >>> print(result)  # verdict, mount, lens, errors and the gravest doubt, a line each
    >>> result.transform.rotation.matrix, result.transform.translation_m
    """
    import numpy as np

    from apexcal.documents.camera_models import parse_model
    from apexcal.documents.errors import DocumentError
    from apexcal.documents.fit_requests import fit_request
    from apexcal.errors import InputError
    from apexcal.printed_result import PrintedResult
    from workers.solver.narrowing import run_search
    from workers.solver.outcomes import SolveError
    from workers.tasks.run_inputs import read_run
    from workers.tasks.solving import solved

    T = np.asarray(_FORWARD if T_camera_lidar is None else T_camera_lidar, np.float64)
    if T.shape != (4, 4):
        raise InputError(f"T_camera_lidar has the shape {T.shape}, not (4, 4)")
    if T_camera_lidar is None:
        request = {"rotation_range_deg": _ANY_MOUNT_DEG, **request}
    mount = {"rotation": {"matrix": T[:3, :3].tolist()}, "translation_m": T[:3, 3].tolist()}
    width, height = (int(pixel) for pixel in image_size)
    try:
        if lens is not None:
            parameters = _parameters(parse_model(model), lens)
            request["locked"] = {**parameters, **request.get("locked", {})}
            request["stated_lens"] = {"model": model, **parameters}
        nominal = {"to_frame": "camera", "from_frame": "lidar", **mount}
        document = fit_request(model, (width, height), nominal, **request).model_dump(mode="json")
        pairs = _columns(points, pixels)
        _check_units(pairs, width, height)
        run = read_run(document, -1, pairs | dict(columns or {}))
        state = run_search(run.problem)
        return PrintedResult.model_validate(solved(run, state), from_attributes=True)
    except (DocumentError, SolveError) as error:
        raise InputError(error.message, error.hint) from None


def _columns(points: ArrayLike, pixels: ArrayLike) -> dict[str, Any]:
    import numpy as np

    from apexcal.errors import InputError

    xyz, uv = np.asarray(points, np.float64), np.asarray(pixels, np.float64)
    if xyz.ndim != 2 or uv.ndim != 2 or xyz.shape[1:] != (3,) or uv.shape != (len(xyz), 2):
        raise InputError(f"points have the shape {xyz.shape} and pixels {uv.shape}, not (N, 3) and (N, 2)")
    return dict(zip("xyzuv", np.column_stack([xyz, uv]).T.tolist(), strict=True))


def _check_units(pairs: dict[str, Any], width: int, height: int) -> None:
    """Raise InputError for points in millimetres, and for an image size as (height, width)."""
    from math import hypot
    from statistics import median

    from apexcal.errors import InputError

    if not pairs["x"]:
        return
    middle = median(map(hypot, pairs["x"], pairs["y"], pairs["z"]))
    if middle > _FARTHEST_MEDIAN_M:
        raise InputError(
            f"half of the points are {middle:,.0f} m or more from the LiDAR: they are not in metres",
            "Give points in metres: millimetres divided by 1000.",
        )
    u, v = max(pairs["u"]), max(pairs["v"])
    if (u > width or v > height) and u <= height and v <= width:
        raise InputError(
            f"marks reach to ({u:.0f}, {v:.0f}), outside of {width} x {height} pixels, but inside {height} x {width}",
            f"Give image_size as (width, height): ({height}, {width}).",
        )


def _parameters(model: Any, lens: Mapping[str, float] | tuple[ArrayLike, ArrayLike]) -> dict[str, float]:
    """Return every intrinsic parameter of the model, f and c in pixels. Raise InputError for another lens."""
    import numpy as np

    from apexcal.documents.camera_models import CAMERA_MODELS
    from apexcal.documents.lenses import coefficients_of
    from apexcal.errors import InputError

    names = CAMERA_MODELS[model].intrinsics
    if not isinstance(lens, Mapping):
        K, D = (np.asarray(part, np.float64) for part in lens)
        coefficients = coefficients_of(model, D.ravel().tolist())
        if K.shape != (3, 3) or coefficients is None:
            raise InputError(
                f"the lens is no K (3, 3) with a D of {model}", "D has further coefficients, or K others."
            )
        lens = {"f_x": K[0, 0], "f_y": K[1, 1], "c_x": K[0, 2], "c_y": K[1, 2], "skew": K[0, 1] / K[0, 0]}
        lens |= dict(zip(CAMERA_MODELS[model].distortion, coefficients, strict=True))
    strange = [name for name, value in lens.items() if name not in names and value]
    if strange:
        raise InputError(f"{model} has no {strange[0]}", f"Its parameters are {', '.join(names)}.")
    return {name: float(lens.get(name, 0.0)) for name in names}
