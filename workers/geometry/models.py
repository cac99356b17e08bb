"""The names of the camera models and of every parameter, in the order of the parameter vector."""

from typing import Final, Literal, get_args

from workers.geometry.errors import GeometryError

ModelName = Literal["pinhole", "brown_conrady", "kannala_brandt"]
SearchForm = Literal["rotation_vector", "euler"]

MODELS: Final[tuple[ModelName, ...]] = get_args(ModelName)
SEARCH_FORMS: Final[tuple[SearchForm, ...]] = get_args(SearchForm)

INTRINSICS: Final[dict[ModelName, tuple[str, ...]]] = {
    "pinhole": ("f_x", "f_y", "c_x", "c_y"),
    "brown_conrady": ("f_x", "f_y", "c_x", "c_y", "skew", "k1", "k2", "k3", "k4", "k5"),
    "kannala_brandt": ("f_x", "f_y", "c_x", "c_y", "k1", "k2", "k3", "k4"),
}
"""Intrinsic parameters per model. f, c in pixels, the rest without a unit.

`brown_conrady` (k1 k2 k3 k4 k5) are OpenCV's (k1 k2 p1 p2 k3) in that order.
"""

EXTRINSICS: Final[dict[SearchForm, tuple[str, ...]]] = {
    "rotation_vector": ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z"),
    "euler": ("alpha", "beta", "gamma", "t_x", "t_y", "t_z"),
}
"""Extrinsic parameters of T_camera_lidar per search form: radians and metres.

`rotation_vector`: R = exp(w) R_nominal, w in the axes of the camera frame. `euler`: R = Rz(alpha) Ry(beta) Rx(gamma).
"""

FORM_ID: Final[dict[SearchForm, int]] = {name: index for index, name in enumerate(SEARCH_FORMS)}


def parse_model(name: object) -> ModelName:
    """The model of that name.

    Raises GeometryError `ambiguous_model` for `fisheye`, which people use for two different models, and
    `unknown_model` for anything else that is none.
    """
    for model in MODELS:
        if name == model:
            return model
    if name == "fisheye":
        raise GeometryError(
            "ambiguous_model",
            "`fisheye` is not a model name here, because people mean one of two models by it.",
            "Ask for `kannala_brandt` (the equidistant model of cv2.fisheye, for true fisheye lenses), or for "
            "`brown_conrady` (radial and tangential polynomial, which the paper calls fisheye).",
        )
    raise GeometryError(
        "unknown_model", f"There is no camera model {name!r}.", f"The models are {', '.join(MODELS)}."
    )


def parse_search_form(name: object) -> SearchForm:
    """The search form of that name. Raises GeometryError `unknown_search_form`."""
    for form in SEARCH_FORMS:
        if name == form:
            return form
    raise GeometryError(
        "unknown_search_form", f"There is no search form {name!r}.", f"The forms are {', '.join(SEARCH_FORMS)}."
    )


def parameter_names(model: ModelName, form: SearchForm) -> tuple[str, ...]:
    """Names of the whole parameter vector: the six extrinsic ones, then the intrinsic ones of the model."""
    return EXTRINSICS[form] + INTRINSICS[model]
