"""How a camera's calibration changed over time: its recommended results in their order."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Final, NamedTuple
from uuid import UUID

from sqlalchemy import ColumnElement, Select, and_, func, or_, select
from sqlalchemy.orm import Session

from apexcal.documents.comparisons import Drift, DriftStep, ResultDifference
from apexcal.documents.publications import PublicationView
from apexcal.documents.results import ComparedResult
from apexcal.documents.states import WorkState
from apexcal.documents.summaries import BetweenModels, Summary
from service.platform.db.base import Json
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Publication, Result
from service.platform.http.pages import invalid_cursor
from service.publications.queries import withdrawals
from service.publications.views import publication_views

# A result's document also has the errors of all its pairs.
_COMPARED: Final = tuple(ComparedResult.model_fields)


class _Recommended(NamedTuple):
    """A recommended result; ``at`` is when its pairs were brought."""

    id: UUID
    calibration_id: UUID
    model: str
    verdict: str | None
    result: ComparedResult
    at: datetime
    withdrawn: PublicationView | None


def drift_of(session: Session, vehicle_id: UUID, camera: str, limit: int, after: str | None = None) -> Drift:
    """The newest recommended results of a camera, in the order of their pairs, each compared.

    ``after`` is the ``next`` of an answer: then the newest of those before it. Raises :class:`Problem` 422
    ``invalid_cursor``.
    """
    statement = _dated(vehicle_id, camera)
    if after is not None:
        statement = statement.having(_before(session, vehicle_id, camera, after))
    newest_first = (_pairs_at().desc(), Calibration.id.desc())
    # One more: the first of the answer is compared with the one before it too.
    rows = session.execute(statement.order_by(*newest_first).limit(limit + 1)).all()
    results = _recommended(session, camera, [(summary, at) for _, summary, at in rows][::-1])
    within = {row[0] for row in rows[:limit]}
    shown = [index for index, result in enumerate(results) if result.calibration_id in within]
    steps = [_step(results, shown, index) for index in shown]
    return Drift(
        vehicle_id=vehicle_id,
        camera=camera,
        sentence=_sentence(camera, steps),
        steps=steps,
        next=rows[limit - 1][0].hex if len(rows) > limit else None,
    )


def _pairs_at() -> ColumnElement[datetime]:
    """When the newest pairs of a calibration were brought."""
    return func.max(func.coalesce(CorrespondenceSet.brought_at, CorrespondenceSet.created_at))


def _dated(vehicle_id: UUID, camera: str) -> Select[UUID, Json | None, datetime]:
    """Calibrations of a camera with their summaries, and when their pairs were brought."""
    return (
        select(Calibration.id, Calibration.summary, _pairs_at().label("at"))
        .join(CalibrationRun, CalibrationRun.calibration_id == Calibration.id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(
            Calibration.vehicle_id == vehicle_id,
            Calibration.state == WorkState.DONE,
            CalibrationRun.camera == camera,
            CalibrationRun.fold == FULL,
        )
        .group_by(Calibration.id)
    )


def _before(session: Session, vehicle_id: UUID, camera: str, cursor: str) -> Any:
    try:
        edge = session.execute(_dated(vehicle_id, camera).where(Calibration.id == UUID(hex=cursor))).one_or_none()
    except ValueError:
        edge = None
    if edge is None:
        raise invalid_cursor(cursor)
    id, _, at = edge
    return or_(_pairs_at() < at, and_(_pairs_at() <= at, Calibration.id < id))


def _recommended(session: Session, camera: str, dated: list[tuple[Json | None, datetime]]) -> list[_Recommended]:
    """The recommended results of calibrations, in their order."""
    chosen: dict[UUID, tuple[datetime, BetweenModels | None]] = {}
    for summary, at in dated:
        of_camera = Summary.model_validate(summary).cameras.get(camera) if summary else None
        model = of_camera and of_camera.models.get(of_camera.recommended or "")
        if model:
            chosen[model.result_id] = at, model.between_models
    of_results = select(
        Result.id, Result.calibration_id, Result.model, Result.verdict, *(Result.document[name] for name in _COMPARED)
    ).where(Result.id.in_(chosen))
    rows: dict[UUID, Any] = {row[0]: row for row in session.execute(of_results)}
    withdrawn = _withdrawn(session, list(rows))
    results: list[_Recommended] = []
    for result_id, (at, spread) in chosen.items():
        if result_id in rows:
            _, calibration_id, name, verdict, *parts = rows[result_id]
            published = {"std": spread.std, "covariance": spread.covariance} if spread else {}
            result = ComparedResult.model_validate(dict(zip(_COMPARED, parts, strict=True)) | published)
            results.append(
                _Recommended(result_id, calibration_id, name, verdict, result, at, withdrawn.get(result_id))
            )
    return results


def _withdrawn(session: Session, result_ids: list[UUID]) -> dict[UUID, PublicationView | None]:
    """By result, the withdrawal of its newest publication, if any."""
    last = dict(withdrawals(session, result_ids))
    ids = [move.id for move in last.values() if move is not None]
    views = {view.id: view for view in publication_views(session, select(Publication).where(Publication.id.in_(ids)))}
    return {result_id: move and views[move.id] for result_id, move in last.items()}


def _step(results: list[_Recommended], shown: list[int], index: int) -> DriftStep:
    """``found[place]`` beside the one before it and the first shown. Withdrawn results are no standard."""
    own = results[index]
    earlier = [at for at in range(index) if results[at].withdrawn is None]
    first = next((at for at in shown if at < index and results[at].withdrawn is None), None)
    return DriftStep(
        result_id=own.id,
        calibration_id=own.calibration_id,
        model=own.model,
        at=own.at,
        intrinsics=own.result.intrinsics,
        transform=own.result.transform,
        std=own.result.std,
        from_previous=_apart(own, results[earlier[-1]]) if earlier else None,
        from_first=None if first is None else _apart(own, results[first]),
        withdrawn=own.withdrawn,
    )


def _apart(later: _Recommended, earlier: _Recommended) -> ResultDifference | None:
    # Imported here: it needs NumPy, which takes a twentieth of the service's start.
    from apexcal.geometry.result_differences import compared

    apart = compared(later.result, earlier.result)
    if apart is not None:
        apart.incomparable = _incomparable(later, earlier)
        apart.differs = apart.differs and apart.incomparable is None
    return apart


def _incomparable(later: _Recommended, earlier: _Recommended) -> str | None:
    """Why the difference of two mounts does not say that the mount moved; None if it does."""
    if later.model != earlier.model:
        return f"their lens models are {earlier.model} and {later.model}, and a mount belongs to its lens"
    if later.result.lens != earlier.result.lens:
        return f"the lens of the earlier result is {earlier.result.lens}, that of the later {later.result.lens}"
    failed = [
        f"the {which} result (pairs of {each.at:%Y-%m-%d %H:%M})"
        for which, each in (("earlier", earlier), ("later", later))
        if each.verdict != "pass"
    ]
    if len(failed) == 2:
        return f"neither {' nor '.join(failed)} passes its checks"
    return f"{failed[0]} does not pass its checks" if failed else None


def _sentence(camera: str, steps: list[DriftStep]) -> str:
    standing = [step for step in steps if step.withdrawn is None]
    left = len(steps) - len(standing)
    withdrawn = f" {left} withdrawn result{' is' if left == 1 else 's are'} left out." if left else ""
    if len(standing) < 2:
        count = len(standing) or "no"
        return f"{camera} has {count} recommended result{'' if count == 1 else 's'}: drift needs two.{withdrawn}"
    jumps = [step for step in standing if step.from_previous and step.from_previous.differs]
    last = standing[-1].from_first
    opening = f"Over {len(standing)} results of {camera} "
    if last is None:
        return f"{opening}drift cannot be judged: not all of them state standard deviations.{withdrawn}"
    size = f"{last.rotation_deg:.2f} degrees and {last.translation_mm:.0f} mm"
    size += f" ({last.sigmas:.1f} standard deviations)"
    if jumps:
        when = ", ".join(f"{step.at:%Y-%m-%d}" for step in jumps)
        return f"{opening}the mount moved (at {when}). The last one differs from the first by {size}.{withdrawn}"
    if last.incomparable:
        unsaid = f"No drift is told: {last.incomparable}."
        return f"{opening}the last one differs from the first by {size}. {unsaid}{withdrawn}"
    if last.differs:
        return f"{opening}no step is significant, but the last one differs from the first by {size}.{withdrawn}"
    return f"{opening}the mount did not move significantly: the last one differs from the first by {size}.{withdrawn}"
