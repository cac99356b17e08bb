"""What may be published: fits to all pairs; with objections, only under an override."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.calibration_runs.objection_queries import objections
from service.db.calibrations import FULL, Result
from service.http.problems import Problem


def check_publishable(result: Result) -> None:
    """Raises :class:`Problem` 409 ``not_publishable`` for a fit that held pairs out."""
    if result.fold != FULL:
        raise Problem(
            409,
            "not_publishable",
            "This result left a block of the pairs out, to measure the model on it.",
            "Publish the result of the same model that was fitted to all pairs.",
        )


def check_objections(session: Session, result: Result, *, is_overridden: bool) -> list[str]:
    """What speaks against giving this result to its camera now. Raises :class:`Problem` 409 ``objections``."""
    against = objections(session, result)
    if against and not is_overridden:
        more = f" ({len(against) - 1} more in `objections`)" if len(against) > 1 else ""
        raise Problem(
            409,
            "objections",
            f"There are objections to publishing this result: {against[0]}{more}",
            'Look at it first. To publish it all the same, say why: {"override": {"reason": "..."}}.',
            objections=against,
        )
    return against
