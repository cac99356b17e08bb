"""``apexcal calibrate-fleet``: one request for all vehicles that a filter names, followed to its end."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from math import ceil
from typing import Annotated, Any
from uuid import UUID

import typer

from apexcal.cli import FAILED
from apexcal.client import Client
from apexcal.commands.choices import FoldsOption, ModelsOption, PresetOption, PublishOption
from apexcal.commands.common import DataOption, JsonOption, TokenOption, UrlOption, bar, say, usage
from apexcal.commands.connect import check_id, connected, find_fleet
from apexcal.documents.fleet_requests import CameraOutcome, Counts, DryRunView, FleetRequestView
from apexcal.embedded.folder import DEFAULT

_SHOWN = 20


def calibrate_fleet(
    fleet: Annotated[str, typer.Option(help="Fleet, by name or id; needed where there are several.")] = "",
    name: Annotated[str | None, typer.Option(help="Only vehicles whose name matches; * and ? are wildcards.")] = None,
    rig: Annotated[str | None, typer.Option(help="Only rigs whose name matches; * and ? are wildcards.")] = None,
    since: Annotated[
        str | None, typer.Option("--not-since", help="Only vehicles not calibrated since, as 2026-11-01T00:00:00Z.")
    ] = None,
    new_pairs: Annotated[
        bool, typer.Option("--new-pairs", help="Only vehicles with pairs newer than their published calibration.")
    ] = False,
    model: ModelsOption = None,
    preset: PresetOption = None,
    folds: FoldsOption = None,
    publish: PublishOption = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would be done.")] = False,
    follow: Annotated[
        str | None, typer.Option(help="Follow this request instead of making one.", metavar="REQUEST")
    ] = None,
    retry: Annotated[
        str | None, typer.Option(help="Calibrate the failed vehicles of this request again.", metavar="REQUEST")
    ] = None,
    cancel: Annotated[str | None, typer.Option(help="End this request.", metavar="REQUEST")] = None,
    url: UrlOption = "",
    token: TokenOption = "",
    data: DataOption = DEFAULT,
    as_json: JsonOption = False,
) -> None:
    """Calibrate each vehicle from its newest pairs; a vehicle without fitting pairs is skipped.

    If --not-since or --new-pairs leave no vehicle, nothing is done and the exit code is 0. It is 1 if a vehicle
    failed or was cancelled.
    """
    # An empty id is an error: treated as none, a mistyped --cancel would calibrate the whole fleet.
    known = [one for one in (follow, retry, cancel) if one is not None]
    if len(known) > 1:
        usage("--follow, --retry and --cancel are about one request each", "Give one of them")
    new = (fleet, name, rig, since, new_pairs, model, preset, folds is not None, publish, dry_run)
    if known and any(new):
        usage(
            "--follow, --retry and --cancel are about a request that was made; all else says what a new one asks",
            "Leave the others out",
        )
    given: dict[str, Any] = {"models": model or None, "preset": preset, "folds": folds}
    calibration = {word: value for word, value in given.items() if value is not None}
    calibration["publish"] = "recommended" if publish else "none"
    wanted = {"name": name, "rig": rig, "not_calibrated_since": _moment(since), "new_pairs": new_pairs or None}
    vehicles = {word: value for word, value in wanted.items() if value is not None}
    with connected(url, token, data) as client:
        if dry_run:
            found = client.fleet_requests.preview(find_fleet(client, fleet).id, vehicles, **calibration)
            say(found, as_json, _what_it_comes_to(found))
            return
        if known:
            request = _known(client, follow, retry, cancel)
        else:
            request = client.fleet_requests.create(find_fleet(client, fleet).id, vehicles, **calibration)
        if cancel is not None:
            say(request, as_json, f"The request {request.id} is asked to end: {_counted(request.counts)}.")
            return
        with bar("Calibrating", not as_json) as progress:
            request = client.wait(request, on_progress=progress)
        lines = [f"The request {request.id} is {request.state.replace('_', ' ')}: {_counted(request.counts)}."]
        if not as_json:
            lines += _reasons(client, request.id)
            outcomes = _outcomes(client, request.id)
            lines += _doubts(outcomes)
            if request.asked.calibration.publish == "recommended":
                lines += _publications(outcomes)
    say(request, as_json, "\n".join(lines))
    if request.state != "done":
        raise typer.Exit(FAILED)


def _known(client: Client, follow: str | None, retry: str | None, cancel: str | None) -> FleetRequestView:
    if retry is not None:
        return client.fleet_requests.retry(check_id(retry, "fleet request"))
    if cancel is not None:
        return client.fleet_requests.cancel(check_id(cancel, "fleet request"))
    return client.fleet_requests.get(check_id(follow or "", "fleet request"))


def _moment(since: str | None) -> str | None:
    """The moment as the service reads it, however it was written."""
    example = "Write it with its zone, as --not-since 2026-11-01T00:00:00Z"
    if since is None:
        return None
    try:
        moment = datetime.fromisoformat(since)
    except ValueError:
        usage(f"--not-since {since!r} is no date and time", example)
    if moment.tzinfo is None:
        usage(f"--not-since {since!r} does not say of which time zone", example)
    return moment.isoformat()


def _counted(counts: Counts) -> str:
    if not counts.matched:
        return "no vehicle is due, and nothing was calibrated"
    named = [f"{count} {state}" for state, count in counts if count and state != "matched"]
    return f"{_count(counts.matched, 'vehicle')}, {', '.join(named)}"


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _reasons(client: Client, request_id: UUID) -> list[str]:
    """Why vehicles failed or were skipped, the first of each."""
    lines: list[str] = []
    for state in ("failed", "skipped"):
        rows = list(client.fleet_requests.vehicles(request_id, state))
        lines += [
            f"  {row.vehicle} {state}: {row.problem.detail or '' if row.problem else ''}" for row in rows[:_SHOWN]
        ]
        if len(rows) > _SHOWN:
            lines.append(f"  ... and {len(rows) - _SHOWN} more {state}")
    return lines


def _outcomes(client: Client, request_id: UUID) -> list[tuple[str, str, CameraOutcome]]:
    """Vehicle, camera and what its calibration recommends."""
    return [
        (row.vehicle, camera, found)
        for row in client.fleet_requests.vehicles(request_id)
        for camera, found in row.cameras.items()
    ]


def _doubts(outcomes: Sequence[tuple[str, str, CameraOutcome]]) -> list[str]:
    """Results whose status is not ok, the first of them; and how many cameras have warnings."""
    doubtful = [one for one in outcomes if (one[2].status or "ok") != "ok"]
    lines = [
        f"  {vehicle} done, but not ok: {camera} is {(found.status or '').replace('_', ' ')}{_warned(found)}"
        for vehicle, camera, found in doubtful[:_SHOWN]
    ]
    if len(doubtful) > _SHOWN:
        lines.append(f"  ... and {len(doubtful) - _SHOWN} more done, but not ok")
    warned = sum(found.warnings > 0 for _, _, found in outcomes)
    if warned:
        lines.append(f"{warned} of {_count(len(outcomes), 'calibrated camera')} came with warnings.")
    return lines


def _warned(found: CameraOutcome) -> str:
    count = found.warnings
    return f", {_count(count, 'warning')}" if count else ""


def _publications(outcomes: Sequence[tuple[str, str, CameraOutcome]]) -> list[str]:
    """Vehicles without a publication and why, the first of them; and for how many cameras a result was published."""
    withheld = [one for one in outcomes if not one[2].published]
    lines = [
        f"  {vehicle}: nothing published for {camera}: {_first_of(found.not_published)}"
        for vehicle, camera, found in withheld[:_SHOWN]
    ]
    if len(withheld) > _SHOWN:
        lines.append(f"  ... and {len(withheld) - _SHOWN} more")
    by_hand = " A reviewer can publish a result on its calibration's page." if withheld else ""
    counted = f"Published for {len(outcomes) - len(withheld)} of {len(outcomes)} calibrated cameras."
    return [*lines, counted + by_hand]


def _first_of(reasons: list[str]) -> str:
    more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
    return (reasons[0] if reasons else "The service does not say why.") + more


def _processor_time(seconds: int) -> str:
    minutes = ceil(seconds / 60)
    return _count(minutes, "processor minute") if minutes < 90 else f"{seconds / 3600:.1f} processor hours"


def _what_it_comes_to(found: DryRunView) -> str:
    first = found.skipped_vehicles[:_SHOWN]
    skipped = [f"  {one.vehicle} skipped: {one.problem.detail}" for one in first]
    if found.skipped > len(skipped):
        skipped.append(f"  ... and {found.skipped - len(skipped)} more skipped")
    sentence = (
        f"The filter names {_count(found.matched, 'vehicle')}: {found.calibrations} would be calibrated in "
        f"{_count(found.runs, 'run')} (at most {_processor_time(found.processor_seconds)}), "
        f"{found.skipped} skipped."
    )
    return "\n".join([sentence, *skipped])
