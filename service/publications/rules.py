"""Rules of publishing and withdrawing: fits to all pairs; against a check of `stop` only with a reason."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy.orm import Session

from apexcal.documents.checks import doubts_of
from apexcal.documents.publications import CURRENT, PublicationRequest
from service.platform.db.calibrations import FULL, Publication, Result
from service.platform.http.problems import conflict, unprocessable
from service.publications.actions import Grounds
from service.publications.check_queries import checks_now
from service.publications.queries import newest_publications, was_published

# Most aliases of a camera: a list of them is one page, and people use two or three.
_MOST_ALIASES = 100


def check_publishable(result: Result) -> None:
    """Raises :class:`Problem` 409 ``not_publishable`` for a fit that held pairs out."""
    if result.fold != FULL:
        raise conflict(
            "not_publishable",
            "This result left a block of the pairs out, to measure the model on it.",
            "Publish the result of the same model that was fitted to all pairs.",
        )


def grounds_of(session: Session, result: Result, body: PublicationRequest, person_id: UUID) -> Grounds:
    """Why this person publishes a result now, with the sentences of the checks that it does not pass.

    Raises:
        Problem: 409 ``checks_stop`` where a check says so, without an override; 422 ``reason_missing`` where the
            alias led to it before.
    """
    failed = doubts_of(checks_now(session, result))
    if failed and failed[0].verdict == "stop" and body.override is None:
        more = f" ({len(failed) - 1} more in `checks`)" if len(failed) > 1 else ""
        raise conflict(
            "checks_stop",
            f"A check says that this result should not be used: {failed[0].sentence}{more}",
            f'{failed[0].remedy} To publish it all the same, say why: {{"override": {{"reason": "..."}}}}.',
            checks=[check.model_dump(mode="json") for check in failed],
        )
    reason = body.override.reason if body.override else body.reason
    if reason is None and was_published(session, result, body.alias):
        raise unprocessable(
            "reason_missing",
            "This result was published before, and another one after it.",
            'Say why it is published again: {"reason": "..."}.',
        )
    return Grounds(person_id, reason, [check.sentence for check in failed])


def check_alias(session: Session, vehicle_id: UUID, camera: str, alias: str) -> None:
    """Raises :class:`Problem` 409 ``too_many_aliases``."""
    if alias == CURRENT:
        return
    names = {move.alias for move in session.scalars(newest_publications(vehicle_id, camera))}
    if alias not in names and len(names) >= _MOST_ALIASES:
        raise conflict(
            "too_many_aliases", f"A camera has at most {_MOST_ALIASES} aliases.", "Move one that is there already."
        )


def check_current(publication: Publication, current: Publication | None) -> None:
    """Raises :class:`Problem` 409 ``not_current`` where the alias has moved on since, or its result was deleted."""
    if current is None or current.id != publication.id:
        raise conflict(
            "not_current",
            f"The alias {publication.alias!r} of {publication.camera!r} leads elsewhere by now.",
            "Withdraw the newest publication: GET /v1/vehicles/{id}/cameras/{camera}/publications lists it first.",
        )
