"""Words that several commands take, as the service knows them; a contract test holds the two together."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from apexcal.commands.common import usage

MODELS = ("pinhole", "brown_conrady", "kannala_brandt")
Model = Literal["pinhole", "brown_conrady", "kannala_brandt"]
Preset = Literal["default", "paper", "toolbox"]
Search = Literal["rotation_vector", "euler"]
Bounds = Literal["image-size", "paper-table-1"]
LensUse = Literal["bounds", "prior", "locked"]
Loss = Literal["mean", "saturating"]
Weights = Literal["auto", "equal", "covariances"]
Outliers = Literal["keep", "exclude"]
Farm = Literal["auto", "slots", "runs"]
Detector = Literal["refined", "tolerant", "strict"]
LidarModel = Literal["vlp16", "vlp32c", "hdl32e", "hdl64e", "alpha_prime"]


def known_model(name: str) -> str:
    """The name, where it is a camera model's; else the command was called wrongly, and ends as such."""
    if name == "fisheye":
        usage(
            "people mean one of two camera models by `fisheye`",
            "Write kannala_brandt (the equidistant model of cv2.fisheye, for true fisheye lenses), or brown_conrady "
            "(the radial and tangential polynomial, which the paper calls fisheye)",
        )
    if name not in MODELS:
        usage(f"there is no camera model {name!r}", f"The models are {', '.join(MODELS)}")
    return name


def _known_models(names: list[str] | None) -> list[str] | None:
    return names and [known_model(name) for name in names]


def _some_left(folds: int | None) -> int | None:
    if folds == 1:
        usage(
            "--folds 1 holds out everything and fits nothing",
            "Give 2 or more blocks, for example --folds 5, or 0 to hold none out",
        )
    return folds


FoldsOption = Annotated[
    int | None, typer.Option(help="Held-out blocks, 0 for none. Otherwise 5.", min=0, callback=_some_left)
]
ModelsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--model",
        metavar="MODEL",
        callback=_known_models,
        help=f"{', '.join(MODELS[:-1])} or {MODELS[-1]}; several times for several. Otherwise all three.",
    ),
]
