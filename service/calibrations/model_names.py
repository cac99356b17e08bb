"""Names of the camera models and of every parameter, in the service's own words.

The workers hold the models themselves (``workers/geometry/models.py``), and the service may not import them; a
contract test asserts that both sides know the same names, and the same presets.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from service.http.problems import Problem

SearchForm = Literal["rotation_vector", "euler"]
BoundsPreset = Literal["image-size", "paper-table-1"]
Loss = Literal["mean", "saturating"]
OutlierRule = Literal["keep", "exclude"]
WeightRule = Literal["auto", "equal", "covariances"]
PresetName = Literal["default", "paper", "toolbox"]

INTRINSICS: dict[str, tuple[str, ...]] = {
    "pinhole": ("f_x", "f_y", "c_x", "c_y"),
    "brown_conrady": ("f_x", "f_y", "c_x", "c_y", "skew", "k1", "k2", "k3", "k4", "k5"),
    "kannala_brandt": ("f_x", "f_y", "c_x", "c_y", "k1", "k2", "k3", "k4"),
}
EXTRINSICS: dict[SearchForm, tuple[str, ...]] = {
    "rotation_vector": ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z"),
    "euler": ("alpha", "beta", "gamma", "t_x", "t_y", "t_z"),
}
MODELS = tuple(INTRINSICS)
# Angles may be given in degrees, under these names with `_deg` behind.
ANGLES = frozenset({"rotation_x", "rotation_y", "rotation_z", "alpha", "beta", "gamma"})


class PresetSize(NamedTuple):
    """How large one iteration of a preset is, and how many there are at most."""

    slots: int
    population: int
    generations: int
    max_iterations: int


PRESETS: dict[PresetName, PresetSize] = {
    "default": PresetSize(4, 800, 30, 60),
    "paper": PresetSize(5, 800, 30, 60),
    "toolbox": PresetSize(20, 2000, 50, 1),
}


def check_model(name: str) -> str:
    """The name itself, if it is a model's. Raises :class:`Problem` 422 ``unknown_model``."""
    if name in INTRINSICS:
        return name
    if name == "fisheye":
        raise Problem(
            422,
            "unknown_model",
            "`fisheye` is not a model name here, because people mean one of two models by it.",
            "Ask for kannala_brandt (the equidistant model of cv2.fisheye, for true fisheye lenses), or for "
            "brown_conrady (the radial and tangential polynomial, which the paper calls fisheye).",
            models=list(MODELS),
        )
    raise Problem(
        422, "unknown_model", f"There is no camera model {name!r}.", f"The models are {', '.join(MODELS)}.",
        models=list(MODELS),
    )  # fmt: skip


def parameter_names(model: str, search: SearchForm) -> tuple[str, ...]:
    """Names of a model's whole parameter vector: the six extrinsic ones, then the intrinsic ones."""
    return EXTRINSICS[search] + INTRINSICS[model]


def all_names(models: Iterable[str], search: SearchForm) -> tuple[str, ...]:
    """Names of every parameter that one of the models has, each once."""
    return tuple(dict.fromkeys(name for model in models for name in parameter_names(model, search)))
