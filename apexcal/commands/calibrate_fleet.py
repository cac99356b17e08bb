"""``apexcal calibrate-fleet``: one request for all vehicles that a filter names, followed to its end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from math import ceil
from typing import Annotated

import typer

from apexcal.client import Client
from apexcal.commands.calibrated import line_of
from apexcal.commands.named import check_id, find_fleet
from apexcal.commands.options import FleetOption, FoldsOption, ModelsOption, PresetOption, PublishOption
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import FAILED, WITHHELD, usage
from apexcal.documents.fleet_requests import CameraOutcome, Counts, DryRunView, FleetRequestView, RequestVehicleView
from apexcal.transport import without_none

_SHOWN = 20


def calibrate_fleet(
    session: Session,
    fleet: FleetOption = "",
    name: str | None = None,
    rig: str | None = None,
    since: Annotated[str | None, typer.Option("--not-since")] = None,
    new_pairs: Annotated[bool, typer.Option("--new-pairs")] = False,
    model: ModelsOption = None,
    preset: PresetOption = None,
    folds: FoldsOption = None,
    publish: PublishOption = False,
    dry_run: Annotated[bool, typer.Option("--dry-run")] = False,
    follow: Annotated[str | None, typer.Option(metavar="REQUEST")] = None,
    retry: Annotated[str | None, typer.Option(metavar="REQUEST")] = None,
    cancel: Annotated[str | None, typer.Option(metavar="REQUEST")] = None,
) -> Reply:
    """Calibrate each vehicle from its newest pairs; a vehicle without fitting pairs is skipped.

    If --not-since or --new-pairs leave no vehicle, nothing is done and the exit code is 0. It is 1 if a vehicle
    failed or was cancelled.

    Args:
        name: Only vehicles with this in their name; with * or ?, whose whole name matches.
        rig: Only rigs with this in their name; with * or ?, whose whole name matches.
        since: Only vehicles not calibrated since, as 2026-11-01T00:00:00Z.
        new_pairs: Only vehicles with pairs newer than their published calibration.
        dry_run: Only say what would be done.
        follow: Follow this request instead of making one.
        retry: Calibrate the failed and cancelled vehicles of this request again.
        cancel: End this request.
    """
    # An empty id is an error: treated as none, a mistyped --cancel would calibrate the whole fleet.
    requests = [each for each in (follow, retry, cancel) if each is not None]
    if len(requests) > 1:
        usage("--follow, --retry and --cancel are about one request each", "Give one of them")
    if requests and any((fleet, name, rig, since, new_pairs, model, preset, folds is not None, publish, dry_run)):
        usage(
            "--follow, --retry and --cancel take a request that was made; the other options are for a new one",
            "Leave the others out",
        )
    calibration = without_none({"models": model or None, "preset": preset, "folds": folds})
    calibration["publish"] = "recommended" if publish else "none"
    vehicles = without_none(
        {"name": name, "rig": rig, "not_calibrated_since": _moment(since), "new_pairs": new_pairs or None}
    )
    client = session.client
    if dry_run:
        preview = client.fleet_requests.preview(find_fleet(client, fleet).id, vehicles, **calibration)
        return Reply(preview, _prediction(preview))
    if requests:
        request_id = check_id(requests[0], "fleet request")
        resource = client.fleet_requests
        request = (resource.retry if retry else resource.cancel if cancel else resource.get)(request_id)
    else:
        request = client.fleet_requests.create(find_fleet(client, fleet).id, vehicles, **calibration)
    if cancel is not None:
        return Reply(request, f"The request {request.id} is asked to end: {_counted(request.counts)}.")
    return _ended(client, session.wait(request, "Calibrating"))


def _ended(client: Client, request: FleetRequestView) -> Reply:
    rows = list(client.fleet_requests.vehicles(request.id))
    outcomes = [(row.vehicle, camera, outcome) for row in rows for camera, outcome in row.cameras.items()]
    publishes = request.asked.calibration.publish == "recommended"
    lines = [f"The request {request.id} is {request.state.replace('_', ' ')}: {_counted(request.counts)}."]
    lines += [*_reasons(rows), *_doubts(outcomes), *(_publications(outcomes) if publishes else [])]
    is_withheld = publishes and not all(outcome.published for _, _, outcome in outcomes)
    code = FAILED if request.state != "done" else WITHHELD if is_withheld else 0
    return Reply(request, "\n".join(lines), code)


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


def _first(lines: Sequence[str], more: str) -> list[str]:
    """The first lines, and how many more there are."""
    rest = len(lines) - _SHOWN
    return [*lines[:_SHOWN], *([f"  ... and {rest} more{more}"] if rest > 0 else [])]


def _reasons(rows: Sequence[RequestVehicleView]) -> list[str]:
    """Why vehicles failed or were skipped, the first of each."""
    return [
        line
        for state in ("failed", "skipped")
        for line in _first(
            [
                f"  {row.vehicle} {state}: {row.problem.detail if row.problem else 'no reason given'}"
                for row in rows
                if row.state == state
            ],
            f" {state}",
        )
    ]


def _doubts(outcomes: Sequence[tuple[str, str, CameraOutcome]]) -> list[str]:
    """Results that should not be used, the first of them; and how many cameras have each verdict."""
    stopped = [f"  {row}, {camera}: {_check_of(each)}" for row, camera, each in outcomes if each.verdict == "stop"]
    verdicts = Counter(outcome.verdict for _, _, outcome in outcomes)
    named = [f"{verdicts[verdict]} {verdict}" for verdict in ("pass", "look", "stop") if verdicts[verdict]]
    lines = _first(stopped, " that should not be used")
    return [*lines, f"Verdicts on {_count(len(outcomes), 'camera')}: {', '.join(named)}."] if named else lines


def _publications(outcomes: Sequence[tuple[str, str, CameraOutcome]]) -> list[str]:
    """Vehicles without a publication and why, the first of them; and for how many cameras a result was published."""
    withheld = [
        f"  {vehicle}: nothing published for {camera}: {_check_of(outcome)}"
        for vehicle, camera, outcome in outcomes
        if not outcome.published
    ]
    by_hand = " A reviewer can publish a result on its calibration's page." if withheld else ""
    counted = f"Published for {len(outcomes) - len(withheld)} of {len(outcomes)} calibrated cameras."
    return [*_first(withheld, ""), counted + by_hand]


def _check_of(outcome: CameraOutcome) -> str:
    if not outcome.checks:
        return "No model is recommended."
    more = f" (and {len(outcome.checks) - 1} more)" if len(outcome.checks) > 1 else ""
    return f"{line_of(outcome.checks[0])}{more}"


def _some(names: Sequence[str], count: int) -> str:
    """Return the first names, and how many more there are."""
    shown = names[:3]
    return ", ".join(shown) + (f" and {_count(count - len(shown), 'other')}" if count > len(shown) else "")


def _processor_time(seconds: int) -> str:
    minutes = ceil(seconds / 60)
    return _count(minutes, "processor minute") if minutes < 90 else f"{seconds / 3600:.1f} processor hours"


def _prediction(preview: DryRunView) -> str:
    skipped = [f"  {_some(each.examples, each.count)} skipped: {each.detail}" for each in preview.reasons]
    sentence = (
        f"The filter names {_count(preview.matched, 'vehicle')}: {preview.calibrations} would be calibrated in "
        f"{_count(preview.runs, 'run')} (at most {_processor_time(preview.processor_seconds)}), "
        f"{preview.skipped} skipped."
    )
    return "\n".join([sentence, *skipped])
