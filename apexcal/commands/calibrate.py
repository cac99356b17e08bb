"""``apexcal calibrate``: calibrates cameras from marks or from a file of pairs."""

from __future__ import annotations

from typing import Annotated, Any
from uuid import UUID

import typer

from apexcal.cli import WITHHELD
from apexcal.client import ApiError, Client
from apexcal.commands.calibrated import tables, why_unpublished
from apexcal.commands.camera_files import camera_and_file, lenses, pairs_of_files, pairs_of_marks, saying_what_stays
from apexcal.commands.named import assignments
from apexcal.commands.options import FoldsOption, ModelsOption, PresetOption, PublishOption
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import usage
from apexcal.documents.bounds import SKEW_BOUNDS, BoundsPreset
from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.camera_models import SearchForm
from apexcal.documents.correspondence_sets import SetView
from apexcal.documents.rules import Farm, LensUse, Loss, OutlierRule, WeightRule


def _check_range(degrees: float | None) -> float | None:
    if degrees is not None and not 0.0 < degrees <= 180.0:  # which NaN is not either
        raise typer.BadParameter(f"{degrees:g} is not above 0 and at most 180 degrees.")
    return degrees


def _locked(texts: list[str] | None) -> dict[str, float]:
    values = assignments(texts, "--lock", "skew=0 or --lock t_z=0.3")
    try:
        return {name: float(value) for name, value in values.items()}
    except ValueError:
        usage(f"--lock {', '.join(texts or ())} is not NAME=VALUE", "Write --lock skew=0 or --lock t_z=0.3")


def calibrate(
    session: Session,
    detection: Annotated[
        str, typer.Option(help="A marked detection: its id, or the recording whose newest it is, by name or @last.")
    ] = "",
    pairs: Annotated[
        list[str] | None,
        typer.Option(
            help="CSV of pairs (x,y,z,u,v and stamp_ns or group), or labels.txt of the paper's toolbox. For several "
            "cameras, repeat it as CAMERA=FILE.",
            metavar="FILE",
        ),
    ] = None,
    machine_marks: Annotated[
        bool,
        typer.Option(
            "--machine-marks", help="The machine's marks count as one more person's; unattended, if nobody marked."
        ),
    ] = False,
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
        OutlierRule | None, typer.Option(help="Whether pairs that do not belong stay in. Otherwise the preset's.")
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
) -> Reply:
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
    locked = _locked(lock)
    if free_skew and "skew" in locked:
        usage("not both: --free-skew fits the skew, --lock fixes it", "Leave one of them out")
    # The service fills in what is not given, because a preset also sets the form of the search and its bounds.
    request: dict[str, Any] = {
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
    client, cameras = session.client, camera or []
    if pairs:
        of_cameras = pairs_of_files(client, pairs, vehicle, rig, cameras)
    else:
        of_cameras = pairs_of_marks(client, detection, cameras, machine_marks=machine_marks)
    request["intrinsics"] = lenses(client, intrinsics or [], [each.camera for each in of_cameras]) or None
    request["publish"] = "recommended" if publish else "none"
    sets: list[SetView] = []
    with saying_what_stays(sets):
        sets.extend(each.make() for each in of_cameras)
        options = {name: value for name, value in request.items() if value is not None}
        calibration = client.calibrations.create(
            sets[0].vehicle_id, [each.id for each in sets], model or None, **options
        )
    calibration = session.wait(calibration, "Calibrating")
    text = [] if session.as_json else [*tables(calibration), f"The calibration is {calibration.id}."]
    text += [] if session.as_json else _publications(client, calibration, publish=publish)
    summaries = calibration.summary.cameras.values() if calibration.summary else ()
    is_withheld = publish and not all(summary.published for summary in summaries)
    return Reply(calibration, text, WITHHELD if is_withheld else 0, f"apexcal open calibration {calibration.id}")


def _publications(client: Client, calibration: CalibrationView, *, publish: bool) -> list[str]:
    """For each camera, which result is now its current calibration, or why none of this calibration is."""
    vehicle = client.vehicles.get(calibration.vehicle_id).name
    sentences: list[str] = []
    for name, camera in (calibration.summary.cameras if calibration.summary else {}).items():
        current = _current_result(client, calibration.vehicle_id, name)
        model = next((model for model, run in camera.models.items() if run.result_id == current), None)
        if model:
            sentences.append(f"{model} is now the current calibration of {name} on {vehicle}.")
        else:
            why = why_unpublished(camera, publish=publish)
            sentences.append(f"Nothing was published for {name} on {vehicle}: {why}")
    return sentences


def _current_result(client: Client, vehicle_id: UUID, camera: str) -> UUID | None:
    try:
        return client.calibrations.current(vehicle_id, camera).result_id
    except ApiError as error:
        if error.code != "no_calibration_yet":
            raise
        return None
