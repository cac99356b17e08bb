"""``apexcal publications``: lists a camera's publications: by whom, when, why, against which objections."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Annotated

import typer

from apexcal.client import ApiError, Client
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, say
from apexcal.commands.connect import connected, find_camera, find_vehicle
from apexcal.documents.fleets import VehicleOut
from apexcal.documents.publications import PublicationView
from apexcal.embedded.folder import DEFAULT

VehicleOption = Annotated[str, typer.Option(help="Vehicle, by name or id; needed where there are several.")]
CameraOption = Annotated[str, typer.Option(help="Camera; needed where the vehicle has several.")]
FleetOption = Annotated[str, typer.Option(help="Fleet, by name or id.")]
OverrideOption = Annotated[
    bool, typer.Option("--override", help="Publish against the service's objections; the reason is kept.")
]


def publications(
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    limit: Annotated[int, typer.Option(help="How many at most, newest first.", min=1)] = 20,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """List a camera's publications, newest first. `apexcal publish RESULT --reason WHY` publishes one again."""
    with connected(url, token, data) as client:
        on, of = find_vehicle_camera(client, fleet, vehicle, camera)
        found = list(islice(client.calibrations.publications(on.id, of), limit))
    listed = [line for publication in found for line in lines(publication)]
    say(found, as_json, "\n".join(listed) or f"Nothing was published for {of} of {on.name} yet.")


def find_vehicle_camera(client: Client, fleet: str, vehicle: str, camera: str) -> tuple[VehicleOut, str]:
    """A vehicle, and the name of a camera of any of its rigs."""
    on = find_vehicle(client, fleet, vehicle)
    rigs = list(client.vehicles.rigs(on.id))
    cameras = list(dict.fromkeys(each.name for rig in rigs for each in rig.cameras))
    return on, find_camera(cameras, camera)


@contextmanager
def saying_objections() -> Iterator[None]:
    """Each of the service's objections on a line of its own, and how to publish all the same."""
    try:
        yield
    except ApiError as error:
        if error.code == "objections":
            listed = "".join(f"\n  {one}" for one in error.fields["objections"])
            error.args = (f"there are objections to publishing this result:{listed}\nNothing was published",)
            error.hint = "To publish it all the same, add --override, and say why with --reason."
        elif error.code == "reason_missing":
            error.hint = "Say why it is given again, with --reason."
        raise


def given(publication: PublicationView, vehicle: str) -> str:
    """What a camera is given now, in a sentence, and what spoke against it."""
    sentence = f"{publication.model} is now the current calibration of {publication.camera} on {vehicle}."
    return "\n".join([sentence, *_against(publication)])


def lines(publication: PublicationView) -> list[str]:
    """Where the alias leads since when, by whom, why, and against which objections."""
    by = f" by {publication.published_by}" if publication.published_by else ""
    current = ", current" if publication.is_current else ""
    to = "withdrawn" if publication.led_to is None else f"{publication.model}, result {publication.result_id}"
    if publication.led_to is not None and publication.result_id is None:
        to = f"result {publication.led_to}, which was deleted"
    reason = [f"  {publication.reason}"] if publication.reason else []
    return [f"{publication.published_at.isoformat()}{by}: {to}{current}", *reason, *_against(publication)]


def _against(publication: PublicationView) -> list[str]:
    objections = publication.override.objections if publication.override else []
    return [f"  Published against: {objection}" for objection in objections]
