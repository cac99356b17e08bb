"""Options that several commands take."""

from __future__ import annotations

from typing import Annotated

import typer

from apexcal.commands.common import usage
from apexcal.documents.camera_models import MODELS, parse_model
from apexcal.documents.errors import DocumentError
from apexcal.documents.schedules import PresetName


def known_model(name: str) -> str:
    """The name of a camera model; any other ends the command as wrong usage."""
    try:
        return parse_model(name)
    except DocumentError as error:
        usage(error.message[0].lower() + error.message[1:].rstrip("."), error.hint)


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
PresetOption = Annotated[
    PresetName | None,
    typer.Option(
        help="What other options leave open. paper: the paper's form, in which wrong marks count; toolbox: the "
        "larger search of its toolbox. Otherwise default: wrong marks do no harm."
    ),
]
PublishOption = Annotated[bool, typer.Option("--publish", help="Publish what is recommended and has no objections.")]
ModelsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--model",
        metavar="MODEL",
        callback=_known_models,
        help=f"{', '.join(MODELS[:-1])} or {MODELS[-1]}; several times for several. Otherwise all three.",
    ),
]
