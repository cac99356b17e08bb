"""``apexcal calibrate``: calibrates cameras from marks or from a file of pairs."""

from __future__ import annotations

from typing import Annotated, Any
from uuid import UUID

import typer

from apexcal.client import ApiError, Client
from apexcal.commands.calibrated import tables, why_unpublished
from apexcal.commands.camera_files import camera_and_file, lenses, pairs_of_files, pairs_of_marks, saying_what_stays
from apexcal.commands.named import assignments
from apexcal.commands.options import (
    FoldsOption,
    IntrinsicsOption,
    LockOption,
    ModelsOption,
    PresetOption,
    PublishOption,
)
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import WITHHELD, usage
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
    detection: str = "",
    pairs: Annotated[list[str] | None, typer.Option(metavar="FILE")] = None,
    machine_marks: Annotated[bool, typer.Option("--machine-marks")] = False,
    vehicle: str = "",
    rig: str = "",
    camera: Annotated[list[str] | None, typer.Option(metavar="NAME")] = None,
    model: ModelsOption = None,
    preset: PresetOption = None,
    search: SearchForm | None = None,
    bounds: BoundsPreset | None = None,
    rotation_range_deg: Annotated[float | None, typer.Option(metavar="DEG", callback=_check_range)] = None,
    stated: Annotated[bool, typer.Option("--stated")] = False,
    intrinsics: IntrinsicsOption = None,
    intrinsics_as: LensUse | None = None,
    lock: LockOption = None,
    free_skew: Annotated[bool, typer.Option("--free-skew")] = False,
    loss: Loss | None = None,
    weights: WeightRule | None = None,
    outliers: OutlierRule | None = None,
    line_time_us: Annotated[float | None, typer.Option(min=-1000.0, max=1000.0, metavar="US")] = None,
    folds: FoldsOption = None,
    seed: Annotated[int | None, typer.Option(min=0)] = None,
    farm: Farm | None = None,
    publish: PublishOption = False,
) -> Reply:
    """Fit every model to each camera's pairs, and say which one to take.

    Args:
        detection: A marked detection, by id; or the newest one of a recording, by its name or @last.
        pairs: CSV of pairs (x,y,z,u,v and stamp_ns or group), or labels.txt of the paper's toolbox. For
            several cameras, repeat it as CAMERA=FILE.
        machine_marks: Use the machine's marks as one more person's; alone, if nobody marked.
        vehicle: Vehicle, by name or id (with --pairs).
        rig: Rig, by name or id (with --pairs).
        camera: Camera; needed if the rig has several. Repeat it to calibrate several cameras and compare
            them.
        search: Form of the rotation. Otherwise the preset's.
        bounds: Bounds of the search. Otherwise the preset's.
        rotation_range_deg: How many degrees the mount may be off the rig's about each axis: above 0; 180 is
            any mount. Otherwise 30.
        stated: Insist on a lens that the recording states.
        intrinsics_as: How a lens that the recording or --intrinsics states is used: prior (refined), locked,
            bounds (looked for near it) or free (fitted, and compared with it). Otherwise auto: locked where the
            pairs leave fewer than 50 degrees of freedom, else prior.
        free_skew: Fit brown_conrady's skew, too.
        loss: Of the search; saturating limits what a wrong mark costs. Otherwise the preset's.
        weights: Whether stated errors weight the pairs. Otherwise auto: if all pairs state them.
        outliers: Whether pairs that do not belong stay in. Otherwise the preset's.
        line_time_us: Rolling shutter: microseconds from an image row to the one below it. Otherwise 0: all at
            once.
        seed: Seed. Otherwise from the request's content.
        farm: How the work is split among workers; the result is the same. Otherwise auto.
    """
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
    request["intrinsics"] = lenses(client, intrinsics or [], {each.camera: None for each in of_cameras}) or None
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
    """Say for each camera which result became its current calibration, or why none did."""
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
