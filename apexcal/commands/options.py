"""Options and arguments that several commands take."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from apexcal.client import Client, ClientError
from apexcal.commands.named import LAST
from apexcal.commands.session import Session
from apexcal.commands.terminal import usage
from apexcal.documents.camera_models import MODELS, parse_model
from apexcal.documents.errors import DocumentError
from apexcal.documents.schedules import PresetName


def check_model(name: str) -> str:
    """The name of a camera model; any other ends the command as wrong usage."""
    try:
        return parse_model(name)
    except DocumentError as error:
        usage(error.message[0].lower() + error.message[1:].rstrip("."), error.hint)


def _check_folds(folds: int | None) -> int | None:
    if folds == 1:
        usage(
            "--folds 1 holds out everything and fits nothing",
            "Give 2 or more blocks, for example --folds 5, or 0 to hold none out",
        )
    return folds


def check_reason(reason: str, sentence: str = "the reason is empty") -> str:
    """The reason without blanks around it; an empty one ends the command as wrong usage."""
    if not reason.strip():
        usage(sentence, "Say why with --reason; it is kept with the publication")
    return reason.strip()


def _completing(list_names: Callable[[Client], Iterable[str]]) -> Callable[[str], list[str]]:
    """Offer names of the service that the environment names, or of the one on this machine; none if it is silent."""

    def complete(incomplete: str) -> list[str]:
        try:
            with Session(os.environ.get("APEXCAL_URL", ""), os.environ.get("APEXCAL_TOKEN", "")).connect(
                2.0
            ) as client:
                return [name for name in (*list_names(client), LAST) if name.startswith(incomplete)]
        except (OSError, ClientError, typer.Exit):
            return []

    return complete


def _vehicles(client: Client) -> Iterator[str]:
    return (vehicle.name for fleet in client.fleets.list() for vehicle in client.vehicles.list(fleet.id))


_complete_vehicle = _completing(_vehicles)
_complete_recording = _completing(lambda client: (recording.name for recording in client.recordings.list()))
complete_name = _completing(
    lambda client: [*_vehicles(client), *(recording.name for recording in client.recordings.list())]
)
FleetOption = Annotated[
    str,
    typer.Option(
        help="Fleet, by name or id; needed where there are several.",
        autocompletion=_completing(lambda client: (fleet.name for fleet in client.fleets.list())),
    ),
]
VehicleOption = Annotated[
    str,
    typer.Option(
        help="Vehicle, by name, id or @last; needed where there are several.", autocompletion=_complete_vehicle
    ),
]
RigOption = Annotated[str, typer.Option(help="Rig, by name or id; needed where there are several.")]
CameraOption = Annotated[str, typer.Option(help="Camera; needed where there are several.")]
CamerasOption = Annotated[list[str] | None, typer.Option(help="Only this camera; may be given several times.")]
RecordingArgument = Annotated[
    str, typer.Argument(help="Recording, by name, id or @last.", autocompletion=_complete_recording)
]
DetectionArgument = Annotated[
    str,
    typer.Argument(
        help="Detection, by id; or the newest one of a recording, by its name or @last.",
        autocompletion=_complete_recording,
    ),
]
ResultArgument = Annotated[
    str,
    typer.Argument(
        help="Result, by id; or the newest recommended one of a vehicle, by its name or @last.",
        autocompletion=_complete_vehicle,
    ),
]
ResultOption = Annotated[
    str, typer.Option(help="Result, by id, vehicle's name or @last; otherwise the current calibration.")
]
AliasOption = Annotated[str, typer.Option(help="The alias to follow, such as canary.")]
ReasonOption = Annotated[str, typer.Option(help="Why; kept with the publication.")]
OverrideOption = Annotated[
    bool, typer.Option("--override", help="Publish although a check says stop; the reason is kept.")
]
LimitOption = Annotated[int, typer.Option(help="How many at most, newest first.", min=1)]
OutputOption = Annotated[Path, typer.Option("--output", "-o", help="File to write.")]
TargetOption = Annotated[
    Path | None, typer.Option("--output", "-o", help="File or folder to write; the help above says the default.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace the file.")]
KeepOption = Annotated[bool, typer.Option("--keep", help="Keep it on the service, too.")]
IntrinsicsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--intrinsics",
        metavar="FILE",
        help="File of a camera's lens, of ROS, OpenCV, Kalibr or KITTI: [CAMERA=]FILE, or FILE#NAME for the camera "
        "NAME of the file. Several times.",
    ),
]
LockOption = Annotated[
    list[str] | None,
    typer.Option(
        "--lock",
        metavar="NAME=VALUE",
        help="Lock a parameter: in pixels, metres and radians, or degrees as NAME_deg. Several times. Skew is locked "
        "at 0.",
    ),
]
FoldsOption = Annotated[
    int | None, typer.Option(help="Held-out blocks, 0 for none. Otherwise 5.", min=0, callback=_check_folds)
]
PresetOption = Annotated[
    PresetName | None,
    typer.Option(
        help="Values of the options that are not stated. paper: the paper's, where wrong marks count; toolbox: the "
        "larger search of its toolbox. Otherwise default: wrong marks do no harm."
    ),
]
PublishOption = Annotated[bool, typer.Option("--publish", help="Publish what is recommended and passes its checks.")]
ModelsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--model",
        metavar="MODEL",
        callback=lambda names: names and [check_model(name) for name in names],
        help=f"{', '.join(MODELS[:-1])} or {MODELS[-1]}; several times for several. Otherwise the first three.",
    ),
]
