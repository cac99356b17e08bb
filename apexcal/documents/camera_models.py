"""The camera models: one record each, with every name that requests, results and other programs' files use."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal, get_args

from apexcal.documents.errors import DocumentError, chosen

ModelName = Literal["pinhole", "brown_conrady", "kannala_brandt", "rational_polynomial"]
SearchForm = Literal["rotation_vector", "euler"]
MODELS: Final[tuple[ModelName, ...]] = get_args(ModelName)
# Fitted and compared where a request names none; the other is for lenses that are known to need it.
DEFAULT_MODELS: Final = MODELS[:3]
SEARCH_FORMS: Final[tuple[SearchForm, ...]] = get_args(SearchForm)

FOCAL_AND_CENTRE: Final = ("f_x", "f_y", "c_x", "c_y")


@dataclass(frozen=True)
class Cost:
    """The cost of a fit on one processor, measured on a 2-core x86-64 machine with AVX2.

    ``individual_ns`` is that of an individual of the search, ``pair_ns`` that of each of its pairs: one thread, the
    dearer loss, 16 to 100,000 pairs. What a pair costs grows with their number; the upper end is taken.
    ``finish_pair_us`` is that of polish, outliers, baselines and uncertainty, for each pair that states covariances;
    equal weights take half.
    """

    individual_ns: float
    pair_ns: float
    finish_pair_us: float


@dataclass(frozen=True)
class WrittenAs:
    """Names of a model in other programs' files: CameraInfo, Kalibr's camchain, Foxglove's CameraCalibration; and
    whether it is cv2.fisheye.
    """

    camera_info: str
    kalibr: str
    foxglove: str
    is_cv2_fisheye: bool = False


_RADIAL_TANGENTIAL: Final = WrittenAs("plumb_bob", "radtan", "plumb_bob")


@dataclass(frozen=True)
class CameraModel:
    """A camera model as the wire knows it.

    ``intrinsics`` are the parameters behind the six extrinsic ones, in order: f and c in pixels, the others without
    unit. ``distortion`` are those of them that make up D, in OpenCV's order; ``tangential`` those of D that are
    tangential. A name such as k3 is that of its place in D: tangential in `brown_conrady`, radial in the others. So
    exports and readers go by D's order and never by name. ``stated_as`` are the distortion models of
    sensor_msgs/CameraInfo, camera_calibration, Foxglove and Kalibr that are this one, in small letters, where D has
    no further coefficients. ``written_as`` is how exports name it; None where other programs have no such model.
    """

    intrinsics: tuple[str, ...]
    cost: Cost
    distortion: tuple[str, ...] = ()
    tangential: tuple[str, ...] = ()
    stated_as: tuple[str, ...] = ()
    written_as: WrittenAs | None = None

    @property
    def is_radial_tangential(self) -> bool:
        """Whether D is OpenCV's k1 k2 p1 p2 k3. Without distortion such a lens is a pinhole's."""
        return self.written_as is _RADIAL_TANGENTIAL


CAMERA_MODELS: Final[dict[ModelName, CameraModel]] = {
    "pinhole": CameraModel(FOCAL_AND_CENTRE, Cost(82.0, 0.35, 520.0), written_as=_RADIAL_TANGENTIAL),
    # OpenCV's k1 k2 p1 p2 k3.
    "brown_conrady": CameraModel(
        (*FOCAL_AND_CENTRE, "skew", "k1", "k2", "k3", "k4", "k5"),
        Cost(168.0, 0.76, 780.0),
        distortion=("k1", "k2", "k3", "k4", "k5"),
        tangential=("k3", "k4"),
        stated_as=("plumb_bob", "rational_polynomial", "radtan", "brown_conrady", "", "none"),
        written_as=_RADIAL_TANGENTIAL,
    ),
    # cv2.fisheye; some drivers write `fisheye` for it.
    "kannala_brandt": CameraModel(
        (*FOCAL_AND_CENTRE, "k1", "k2", "k3", "k4"),
        Cost(244.0, 0.98, 600.0),
        distortion=("k1", "k2", "k3", "k4"),
        stated_as=("equidistant", "fisheye", "kannala_brandt", "kannala_brandt4"),
        written_as=WrittenAs("equidistant", "equidistant", "kannala_brandt", is_cv2_fisheye=True),
    ),
    # OpenCV's k1 k2 p1 p2 k3 k4 k5 k6.
    "rational_polynomial": CameraModel(
        (*FOCAL_AND_CENTRE, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
        Cost(7000.0, 0.95, 950.0),
        distortion=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
        tangential=("p1", "p2"),
        # OpenCV reads eight coefficients so, whatever a driver calls them.
        stated_as=("rational_polynomial", "plumb_bob", ""),
        written_as=WrittenAs("rational_polynomial", "", "rational_polynomial"),
    ),
}
INTRINSICS: Final = {name: model.intrinsics for name, model in CAMERA_MODELS.items()}

EXTRINSICS: Final[dict[SearchForm, tuple[str, ...]]] = {
    "rotation_vector": ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z"),
    "euler": ("alpha", "beta", "gamma", "t_x", "t_y", "t_z"),
}
"""Extrinsic parameters of T_camera_lidar in each form of the search: radians and metres.

`rotation_vector`: R = exp(w) R_nominal, w in the axes of the camera frame. `euler`: R = Rz(alpha) Ry(beta) Rx(gamma).
"""
# People may give angles in degrees, under these names with `_deg` behind.
ANGLES: Final = frozenset({"rotation_x", "rotation_y", "rotation_z", "alpha", "beta", "gamma"})


def parse_model(name: object) -> ModelName:
    """The camera model of that name.

    Raises:
        DocumentError: ``unknown_model``; for `fisheye`, which people use for two models, it names both.
    """
    if name == "fisheye":
        raise DocumentError(
            "unknown_model",
            "`fisheye` is not a model name here, because people mean one of two models by it.",
            "Ask for kannala_brandt (the equidistant model of cv2.fisheye, for true fisheye lenses), or for "
            "brown_conrady (the radial and tangential polynomial, which the paper calls fisheye).",
            models=list(MODELS),
        )
    return chosen(name, MODELS, "model")


def parse_search_form(name: object) -> SearchForm:
    """The search form of that name. Raises DocumentError ``unknown_search_form``."""
    return chosen(name, SEARCH_FORMS, "search_form")


def parameter_names(model: ModelName, form: SearchForm) -> tuple[str, ...]:
    """Names of the whole parameter vector: the six extrinsic ones, then the model's intrinsic ones."""
    return EXTRINSICS[form] + INTRINSICS[model]


def all_names(models: Iterable[ModelName], form: SearchForm) -> tuple[str, ...]:
    """Names of every parameter that one of the models has, each once."""
    return tuple(dict.fromkeys(name for model in models for name in parameter_names(model, form)))


def bare_name(name: str) -> str:
    """A parameter's own name: without the `_deg` of an angle that is given in degrees."""
    stem = name.removesuffix("_deg")
    return stem if stem in ANGLES else name
