"""``apexcal calibrate``: from marks, or from a file of pairs, to results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from apexcal.client import ApiError, Client, ClientError
from apexcal.commands.calibrated import show, why_unpublished
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say, usage
from apexcal.commands.connect import check_id, connected, find_camera, find_rig, find_vehicle
from apexcal.embedded.folder import DEFAULT
from apexcal.transport import Document


def calibrate(
    detection: Annotated[str, typer.Option(help="Id of a detection whose vertices people have marked.")] = "",
    pairs: Annotated[Path | None, typer.Option(help="CSV of pairs: x,y,z,u,v and stamp_ns or group.")] = None,
    vehicle: Annotated[str, typer.Option(help="Vehicle, by name or id (with --pairs).")] = "",
    rig: Annotated[str, typer.Option(help="Rig, by name or id (with --pairs).")] = "",
    camera: Annotated[str, typer.Option(help="Camera; needed where the rig has several.")] = "",
    model: Annotated[list[str] | None, typer.Option(help="Camera model; several times. Otherwise all three.")] = None,
    preset: Annotated[str | None, typer.Option(help="default, paper or toolbox; default.")] = None,
    search: Annotated[str | None, typer.Option(help="rotation_vector or euler; as the preset has it.")] = None,
    bounds: Annotated[str | None, typer.Option(help="image-size or paper-table-1; as the preset has it.")] = None,
    stated: Annotated[
        bool, typer.Option("--stated", help="Look for focal lengths and centre near those that the recording states.")
    ] = False,
    outliers: Annotated[
        str | None, typer.Option(help="keep or exclude the pairs that are judged not to belong; keep.")
    ] = None,
    folds: Annotated[int | None, typer.Option(help="Held-out blocks, 0 for none; 5.", min=0)] = None,
    seed: Annotated[int | None, typer.Option(help="Seed; otherwise from the request's content.")] = None,
    farm: Annotated[str | None, typer.Option(help="auto, slots or runs; auto.")] = None,
    publish: Annotated[bool, typer.Option(help="Make the recommended result the camera's current one.")] = True,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Fit every model to a camera's pairs, and say which one to take."""
    if detection and pairs is not None:
        usage("not both: --detection takes the pairs from marks, --pairs from a file", "Leave one of them out")
    if not detection and pairs is None:
        usage("calibrate needs either --detection or --pairs", "Give the id of a marked detection, or a CSV file")
    if folds == 1:
        usage(
            "--folds 1 holds out everything and fits nothing",
            "Give 2 or more blocks, for example --folds 5, or 0 to hold none out",
        )
    if outliers not in (None, "keep", "exclude"):
        usage(f"--outliers {outliers!r} is neither keep nor exclude", "Write --outliers exclude to leave them out")
    # What is not given is left to the service: a preset means more than its schedule.
    given = {
        "preset": preset,
        "search": search,
        "bounds_preset": bounds,
        "intrinsics_from": "recording" if stated else None,
        "outliers": outliers,
        "folds": folds,
        "seed": seed,
        "farm": farm,
    }
    with connected(url, token, data) as client:
        chosen = _import(client, pairs, vehicle, rig, camera) if pairs else _build(client, detection, camera)
        calibration = client.calibrations.create(
            chosen["vehicle_id"],
            [chosen["id"]],
            model or None,
            **{name: value for name, value in given.items() if value is not None},
            publish="recommended" if publish else "none",
        )
        with bar("Calibrating", not as_json) as progress:
            calibration = client.wait(calibration, on_progress=progress)
        published = [] if as_json else _publications(client, calibration, wanted=publish)
    if not as_json:
        show(calibration)
    say(calibration, as_json, "\n".join([f"The calibration is {calibration['id']}.", *published]))


def _import(client: Client, path: Path, vehicle: str, rig: str, camera: str) -> Document:
    try:
        text = path.read_bytes()
    except OSError as error:
        raise ClientError(f"cannot read {path}: {(error.strerror or '').lower()}") from None
    with_rig = find_rig(client, find_vehicle(client, "", vehicle), rig)
    return client.correspondence_sets.import_csv(with_rig["id"], find_camera(with_rig, camera), text)


def _build(client: Client, detection_id: str, camera: str) -> Document:
    found = client.detections.get(check_id(detection_id, "detection", "`apexcal detect`"))
    recording = client.recordings.get(found["recording_id"])
    with_rig = client.vehicles.rig(recording["rig_id"])
    return client.correspondence_sets.build(detection_id, find_camera(with_rig, camera))


def _publications(client: Client, calibration: Document, *, wanted: bool) -> list[str]:
    """For each camera, which result the vehicle is given now, or why it is none of this calibration."""
    vehicle = client.vehicles.get(calibration["vehicle_id"])["name"]
    sentences: list[str] = []
    for name, camera in (calibration.get("summary") or {}).get("cameras", {}).items():
        current = _current_result(client, calibration["vehicle_id"], name)
        model = next((model for model, found in camera["models"].items() if found["result_id"] == current), None)
        if model:
            sentences.append(f"{model} is now the current calibration of {name} on {vehicle}.")
        else:
            why = why_unpublished(calibration, camera, wanted=wanted)
            sentences.append(f"Nothing was published for {name} on {vehicle}: {why}")
    return sentences


def _current_result(client: Client, vehicle_id: str, camera: str) -> str | None:
    try:
        return str(client.calibrations.current(vehicle_id, camera)["result_id"])
    except ApiError as error:
        if error.code != "no_calibration_yet":
            raise
        return None
