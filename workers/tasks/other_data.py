"""Read the validations of a result on data that it was not fitted to."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Final
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session, aliased

from apexcal.documents.states import WorkState
from apexcal.documents.validations import DATA_BY_KIND
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.calibrations import CalibrationRun, CorrespondenceSet, Result
from service.platform.db.recordings import Recording

# Validations of a result that are read, the newest first.
_MOST: Final = 20


def other_data(session: Session, results: Sequence[Result]) -> dict[UUID, list[Json]]:
    """Return what validations of each result found, without single pairs: the newest for each set or recording.

    Pairs of the recording that the result was fitted to do not count.
    """
    fitted = aliased(CorrespondenceSet)
    rows = session.execute(
        select(Analysis, CorrespondenceSet, fitted.id, fitted.recording_id)
        .join(Result, Result.id == Analysis.result_id)
        .join(CalibrationRun, CalibrationRun.id == Result.run_id)
        .join(fitted, fitted.id == CalibrationRun.set_id)
        .outerjoin(CorrespondenceSet, CorrespondenceSet.id == Analysis.set_id)
        .where(Analysis.result_id.in_([result.id for result in results]), Analysis.state == WorkState.DONE)
        .where(Analysis.kind.in_(DATA_BY_KIND))
        .order_by(Analysis.id.desc())
        .limit(_MOST * len(results))
    ).all()
    used = {row.recording_id or (pairs and pairs.recording_id) for row, pairs, *_ in rows}
    named = select(Recording.id, Recording.name).where(Recording.id.in_(used))
    names: dict[UUID | None, str] = {row.id: row.name for row in session.execute(named)} if rows else {}
    by_result: dict[UUID, dict[tuple[str, UUID | None], Json]] = defaultdict(dict)
    for row, pairs, fitted_set, fitted_recording in rows:
        of_pairs = pairs.recording_id if pairs else None
        is_fitted = row.set_id == fitted_set or (of_pairs is not None and of_pairs == fitted_recording)
        if is_fitted or row.result is None:
            continue
        data = names.get(row.recording_id or of_pairs) or f"pairs from {pairs.source if pairs else 'elsewhere'}"
        at = f"{row.created_at:%Y-%m-%d %H:%M} UTC"
        content = row.result | {"kind": DATA_BY_KIND[row.kind], "data": data, "at": at, "id": str(row.id)}
        content["recording_id"] = row.recording_id and str(row.recording_id)
        assert row.result_id is not None
        by_result[row.result_id].setdefault((row.kind, row.set_id or row.recording_id), content)
    return {result.id: list(by_result[result.id].values()) for result in results}
