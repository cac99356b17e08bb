"""``apexcal calibrate``: calibrates cameras from marks or from a file of pairs."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

import typer

from apexcal.client import ApiError, Client
from apexcal.commands.calibrated import show, why_unpublished
from apexcal.commands.camera_files import (
    camera_and_file,
    lenses,
    pairs_of_files,
    pairs_of_marks,
    saying_what_stays,
)
from apexcal.commands.choices import FoldsOption, ModelsOption, PresetOption, PublishOption
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say, usage
from apexcal.commands.connect import connected
from apexcal.documents.bounds import SKEW_BOUNDS, BoundsPreset
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.camera_models import SearchForm
from apexcal.documents.correspondence_sets import SetView
from apexcal.documents.rules import Farm, LensUse, Loss, OutlierRule, WeightRule
from apexcal.embedded.folder import DEFAULT


def _check_range(degrees: float | None) -> float | None:
    if degrees is not None and not 0.0 < degrees <= 180.0:  # which NaN is not either
        raise typer.BadParameter(f"{degrees:g} is not above 0 and at most 180 degrees.")
    return degrees


def _locked(given: str) -> tuple[str, float]:
    name, _, value = given.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        usage(f"--lock is {given!r}, not NAME=VALUE", "Write --lock skew=0 or --lock t_z=0.3")


def calibrate(
    detection: Annotated[str, typer.Option(help="Id of a detection whose vertices people have marked.")] = "",
    pairs: Annotated[
        list[str] | None,
        typer.Option(
            help="CSV of pairs (x,y,z,u,v and stamp_ns or group), or labels.txt of the paper's toolbox. For several "
            "cameras, repeat it as CAMERA=FILE.",
            metavar="FILE",
        ),
    ] = None,
    vehicle: Annotated[str, typer.Option(help="Vehicle, by name or id (with --pairs).")] = "",
    rig: Annotated[str, typer.Option(help="Rig, by name or id (with --pairs).")] = "",
    camera: Annotated[
        list[str] | None,
        typer.Option(
            help="Camera; needed if the rig has several. Repeat it to calibrate several cameras and compare them.",
            metavar="NAME",
        ),
    ] = None,
    model: ModelsOption = None,
    preset: PresetOption = None,
    search: Annotated[SearchForm | None, typer.Option(help="Form of the rotation. Otherwise the preset's.")] = None,
    bounds: Annotated[BoundsPreset | None, typer.Option(help="Bounds of the search. Otherwise the preset's.")] = None,
    rotation_range_deg: Annotated[
        float | None,
        typer.Option(
            help="How many degrees the mount may be off the rig's about each axis: above 0; 180 is any mount. "
            "Otherwise 30.",
            metavar="DEG",
            callback=_check_range,
        ),
    ] = None,
    stated: Annotated[bool, typer.Option("--stated", help="Insist on a lens that the recording states.")] = False,
    intrinsics: Annotated[
        list[str] | None,
        typer.Option(
            help="File of known intrinsics, of ROS, OpenCV, Kalibr or KITTI: [CAMERA=]FILE, or FILE#NAME for the "
            "camera NAME of the file.",
            metavar="FILE",
        ),
    ] = None,
    intrinsics_as: Annotated[
        LensUse | None,
        typer.Option(
            help="How a lens that the recording or --intrinsics states is used: prior (refined), locked, bounds "
            "(looked for near it) or free (fitted, and compared with it). Otherwise prior."
        ),
    ] = None,
    lock: Annotated[
        list[str] | None,
        typer.Option(
            help="Lock a parameter: NAME=VALUE, in pixels, metres and radians, or degrees as NAME_deg. Repeat it for "
            "several. Skew is locked at 0.",
            metavar="NAME=VALUE",
        ),
    ] = None,
    free_skew: Annotated[bool, typer.Option("--free-skew", help="Fit brown_conrady's skew, too.")] = False,
    loss: Annotated[
        Loss | None,
        typer.Option(help="Of the search; saturating limits what a wrong mark costs. Otherwise the preset's."),
    ] = None,
    weights: Annotated[
        WeightRule | None,
        typer.Option(help="Whether stated errors weight the pairs. Otherwise auto: if all pairs state them."),
    ] = None,
    outliers: Annotated[
        OutlierRule | None,
        typer.Option(help="Whether pairs that do not belong stay in. Otherwise the preset's."),
    ] = None,
    line_time_us: Annotated[
        float | None,
        typer.Option(
            help="Rolling shutter: microseconds from an image row to the one below it. Otherwise 0: all at once.",
            min=-1000.0,
            max=1000.0,
            metavar="US",
        ),
    ] = None,
    folds: FoldsOption = None,
    seed: Annotated[int | None, typer.Option(help="Seed. Otherwise from the request's content.", min=0)] = None,
    farm: Annotated[
        Farm | None, typer.Option(help="How the work is split among workers; the result is the same. Otherwise auto.")
    ] = None,
    publish: PublishOption = False,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Fit every model to each camera's pairs, and say which one to take."""
    if detection and pairs:
        usage("not both: --detection takes the pairs from marks, --pairs from a file", "Leave one of them out")
    if not detection and not pairs:
        usage("calibrate needs either --detection or --pairs", "Give the id of a marked detection, or a CSV file")
    if detection and (vehicle or rig):
        usage("a detection belongs to one rig already", "Leave out --vehicle and --rig, or give --pairs")
    if pairs and camera and (len(camera) > 1 or len(pairs) > 1 or camera_and_file(pairs[0])[0]):
        usage(
            "--camera names the camera of one file of pairs", "Write several as --pairs CAMERA=FILE, without --camera"
        )
    if stated and intrinsics:
        usage(
            "not both: --stated takes the lens that the recording states, --intrinsics the one of a file",
            "Leave one of them out",
        )
    locked = dict(_locked(one) for one in lock or [])
    if free_skew and "skew" in locked:
        usage("not both: --free-skew fits the skew, --lock fixes it", "Leave one of them out")
    # The service fills in what is not given, because a preset also sets the form of the search and its bounds.
    given: dict[str, object] = {
        "preset": preset,
        "search": search,
        "bounds_preset": bounds,
        "rotation_range_deg": rotation_range_deg,
        "intrinsics_from": "recording" if stated else None,
        "intrinsics_as": intrinsics_as,
        "locked": locked or None,
        "bounds": {"skew": SKEW_BOUNDS} if free_skew else None,
        "loss": loss,
        "weights": weights,
        "outliers": outliers,
        "line_time_us": line_time_us,
        "folds": folds,
        "seed": seed,
        "farm": farm,
    }
    with connected(url, token, data) as client:
        cameras = camera or []
        of_cameras = (
            pairs_of_files(client, pairs, vehicle, rig, cameras)
            if pairs
            else pairs_of_marks(client, detection, cameras)
        )
        given["intrinsics"] = lenses(client, intrinsics or [], [one.camera for one in of_cameras]) or None
        sets: list[SetView] = []
        with saying_what_stays(sets):
            sets.extend(one.make() for one in of_cameras)
            calibration = client.calibrations.create(
                sets[0].vehicle_id,
                [one.id for one in sets],
                model or None,
                **{name: value for name, value in given.items() if value is not None},
                publish="recommended" if publish else "none",
            )
        with bar("Calibrating", not as_json) as progress:
            calibration = client.wait(calibration, on_progress=progress)
        published = [] if as_json else _publications(client, calibration, wanted=publish)
    if not as_json:
        show(calibration)
    say(calibration, as_json, "\n".join([f"The calibration is {calibration.id}.", *published]))


def _publications(client: Client, calibration: CalibrationView, *, wanted: bool) -> list[str]:
    """For each camera, which result is now its current calibration, or why none of this calibration is."""
    vehicle = client.vehicles.get(calibration.vehicle_id).name
    sentences: list[str] = []
    for name, camera in (calibration.summary.cameras if calibration.summary else {}).items():
        current = _current_result(client, calibration.vehicle_id, name)
        model = next((model for model, found in camera.models.items() if found.result_id == current), None)
        if model:
            sentences.append(f"{model} is now the current calibration of {name} on {vehicle}.")
        else:
            why = why_unpublished(camera, wanted=wanted)
            sentences.append(f"Nothing was published for {name} on {vehicle}: {why}")
    return sentences


def _current_result(client: Client, vehicle_id: UUID, camera: str) -> UUID | None:
    try:
        return client.calibrations.current(vehicle_id, camera).result_id
    except ApiError as error:
        if error.code != "no_calibration_yet":
            raise
        return None
