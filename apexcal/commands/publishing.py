"""Moves of a camera's aliases: ``publish``, ``withdraw``, ``rollback``, ``alias``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice, pairwise
from typing import Annotated
from uuid import UUID

import typer

from apexcal.client import ApiError, ClientError
from apexcal.commands.calibrated import line_of
from apexcal.commands.named import find_result, find_vehicle_camera
from apexcal.commands.options import (
    CameraOption,
    FleetOption,
    LimitOption,
    OverrideOption,
    ReasonOption,
    ResultArgument,
    VehicleOption,
    check_reason,
)
from apexcal.commands.session import Reply, Session
from apexcal.commands.terminal import usage
from apexcal.documents.checks import Check
from apexcal.documents.publications import PublicationView


def publish(
    session: Session,
    result: ResultArgument,
    reason: ReasonOption = "",
    override: OverrideOption = False,
    camera: CameraOption = "",
) -> Reply:
    """Make a result its camera's current calibration. Against a check of `stop` this takes --override."""
    client = session.client
    if override:
        check_reason(reason, "--override needs a reason")
    with _saying_checks():
        chosen = find_result(client, result, camera)
        publication = client.calibrations.publish(chosen, reason.strip() or None, override=override)
    vehicle = client.vehicles.get(publication.vehicle_id)
    after = f"apexcal export --vehicle {vehicle.id} --camera {publication.camera} -o {publication.camera}.json"
    return Reply(publication, _is_current(publication, vehicle.name), next=after)


def withdraw(
    session: Session,
    reason: Annotated[str, typer.Option(show_default=False)],
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
) -> Reply:
    """Take back a camera's current calibration. The camera gets none until a result is published.

    `apexcal rollback` or `apexcal publish` publishes an older result again.

    Args:
        reason: Why it must not be used; cars are told.
    """
    reason = check_reason(reason)
    on, of = find_vehicle_camera(session.client, fleet, vehicle, camera)
    newest = next(session.client.calibrations.publications(on.id, of), None)
    if newest is None or newest.result_id is None:
        raise ClientError(f"camera {of} of {on.name} has no current calibration", "There is nothing to withdraw.")
    move = session.client.calibrations.withdraw(newest.id, reason)
    when = f"{newest.published_at:%Y-%m-%d %H:%M}"
    return Reply(
        move,
        f"Camera {of} of {on.name} has no current calibration now: {newest.model}, published {when}, is withdrawn.",
    )


def rollback(
    session: Session,
    reason: Annotated[str, typer.Option(show_default=False)],
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    override: OverrideOption = False,
) -> Reply:
    """Restore the result that a camera had before the current one. Nothing is deleted.

    A second call goes back one further. `apexcal ls publications` lists all results, `apexcal publish` publishes any.

    Args:
        reason: Why it goes back; kept with the publication.
    """
    reason = check_reason(reason)
    on, of = find_vehicle_camera(session.client, fleet, vehicle, camera)
    previous = _previous(list(session.client.calibrations.publications(on.id, of)))
    if previous is None:
        raise ClientError(
            f"{of} of {on.name} had no result before the current one",
            "`apexcal ls publications` lists what it was given.",
        )
    with _saying_checks():
        publication = session.client.calibrations.publish(previous, reason, override=override)
    return Reply(publication, _is_current(publication, on.name))


def alias(
    session: Session,
    name: Annotated[str, typer.Argument()] = "",
    result: str = "",
    remove: Annotated[bool, typer.Option("--remove")] = False,
    reason: ReasonOption = "",
    override: OverrideOption = False,
    vehicle: VehicleOption = "",
    camera: CameraOption = "",
    fleet: FleetOption = "",
    limit: LimitOption = 20,
) -> Reply:
    """List a camera's aliases, or the moves of one. With --result or --remove, move it.

    A vehicle that pulls with --alias NAME gets what the alias leads to. `current` moves with `apexcal publish`.

    Args:
        name: The alias; without it all are listed.
        result: Let it lead to this result.
        remove: Let it lead nowhere.
    """
    if result and remove:
        usage("--result and --remove exclude each other")
    if result or remove:
        reason = check_reason(reason if name else "", "a move takes the alias and a reason")
    calibrations = session.client.calibrations
    on, of = find_vehicle_camera(session.client, fleet, vehicle, camera)
    if remove:
        newest = next(calibrations.publications(on.id, of, name), None)
        if newest is None:
            raise ClientError(f"{of} of {on.name} has no alias {name}", "`apexcal alias` lists those that it has.")
        moves = calibrations.withdraw(newest.id, reason)
    elif result:
        target = calibrations.result(result := find_result(session.client, result, of))
        if (target.vehicle_id, target.camera) != (on.id, of):
            raise ClientError("this result is of another camera or vehicle", f"Take one of {of} of {on.name}.")
        with _saying_checks():
            moves = calibrations.publish(result, reason, override=override, alias=name)
    elif name:
        moves = list(islice(calibrations.publications(on.id, of, name), limit))
    else:
        moves = calibrations.aliases(on.id, of)
    listed = moves if isinstance(moves, list) else [moves]
    lines = [
        "\n".join([f"{move.alias} of {move.camera}", *(f"  {line}" for line in lines_of(move))]) for move in listed
    ]
    return Reply(moves, "\n".join(lines) or f"{of} of {on.name} has no such alias yet.")


@contextmanager
def _saying_checks() -> Iterator[None]:
    """Say which checks the result does not pass, a line each, and how to publish all the same."""
    try:
        yield
    except ApiError as error:
        if error.code == "checks_stop":
            listed = "".join(f"\n  {line_of(Check.model_validate(check))}" for check in error.fields["checks"])
            error.args = (f"this result does not pass its checks:{listed}\nNothing was published",)
            error.hint = "To publish it all the same, add --override, and say why with --reason."
        elif error.code == "reason_missing":
            error.hint = "Say why it is published again, with --reason."
        raise


def _previous(moves: list[PublicationView]) -> UUID | None:
    """The result given before the current one was first given, so going back twice goes further back.

    ``moves``: the newest first. Results that were withdrawn or deleted are skipped.
    """
    withdrawn = {before.led_to for after, before in pairwise(moves) if after.led_to is None}
    results = [move.led_to for move in moves if move.led_to is not None]
    first = max((index for index, result in enumerate(results) if result == results[0]), default=0)
    skipped = withdrawn | {move.led_to for move in moves if move.result_id is None}
    return next((result for result in results[first + 1 :] if result not in skipped), None)


def _is_current(publication: PublicationView, vehicle: str) -> str:
    """Say in a sentence which calibration a camera gets now, and what spoke against it."""
    sentence = f"{publication.model} is now the current calibration of {publication.camera} on {vehicle}."
    return "\n".join([sentence, *_against(publication)])


def lines_of(publication: PublicationView) -> list[str]:
    """Say where the alias leads, since when, by whom, why, and against which checks."""
    by = f" by {publication.published_by}" if publication.published_by else ""
    current = ", current" if publication.is_current else ""
    to = "withdrawn" if publication.led_to is None else f"{publication.model}, result {publication.result_id}"
    if publication.led_to is not None and publication.result_id is None:
        to = f"result {publication.led_to}, which was deleted"
    reason = [f"  {publication.reason}"] if publication.reason else []
    return [f"{publication.published_at.isoformat()}{by}: {to}{current}", *reason, *_against(publication)]


def _against(publication: PublicationView) -> list[str]:
    sentences = publication.override.sentences if publication.override else []
    return [f"  Published although: {sentence}" for sentence in sentences]
