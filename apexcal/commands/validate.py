"""``apexcal validate``: tests a calibration on data that it was not fitted to."""

from __future__ import annotations

from typing import Annotated, cast, get_args

import typer

from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say, usage
from apexcal.commands.connect import check_id, connected, find_recording, find_vehicle
from apexcal.documents.validations import RoadScore, ValidationKind, ValidationView
from apexcal.embedded.folder import DEFAULT

_KINDS = get_args(ValidationKind)


def validate(
    vehicle: Annotated[str, typer.Argument(help="Vehicle, by id or by name.")],
    kind: Annotated[str, typer.Argument(help="pairs, lanes or edges.")],
    data_of: Annotated[
        str,
        typer.Argument(metavar="DATA", help="Id of a correspondence set for pairs; otherwise a recording."),
    ],
    camera: Annotated[str, typer.Option(help="Camera, by its name in the rig.")],
    result: Annotated[str, typer.Option(help="Id of a result; otherwise the camera's current calibration.")] = "",
    fleet: Annotated[str, typer.Option(help="Fleet, by id or name; needed where there are several.")] = "",
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Score a calibration without fitting it: on other pairs, on lane markers, or on edges of a drive.

    `pairs` compares the errors with what the calibration states. `lanes` asks whether the ground's bright points lie
    on bright pixels. `edges` asks whether depth steps lie on image gradients, and finds a camera that was knocked.
    """
    if kind not in _KINDS:
        usage(f"{kind!r} is no kind of validation.", f"It is one of {', '.join(_KINDS)}.")
    with connected(url, token, data) as client, bar("Validating", not as_json) as progress:
        of = find_vehicle(client, fleet, vehicle)
        asked = client.validations.ask(
            of.id,
            cast("ValidationKind", kind),
            camera,
            set_id=check_id(data_of, "correspondence set") if kind == "pairs" else None,
            recording_id=find_recording(client, data_of).id if kind != "pairs" else None,
            result_id=check_id(result, "result") if result else None,
        )
        done = client.wait(asked, on_progress=progress)
    say(done, as_json, _sentence(done))


def _sentence(done: ValidationView) -> str:
    found = done.result
    assert found is not None
    said = f"{found.verdict}: {found.sentence}"
    if isinstance(found, RoadScore) and found.score is not None and found.score_at_one_degree is not None:
        said += f"\nScore {found.score:.2f}; {found.score_at_one_degree:.2f} at 1 degree of yaw."
    return said
