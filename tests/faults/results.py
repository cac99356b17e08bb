"""What a calibration's runs found, without what differs between two runs of the same bits."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.models import CalibrationRun, Result, Slot

_TIMES = ("finish_seconds",)
Documents = dict[tuple[str, str, int], dict[str, Any]]


def documents(session: Session, calibration_id: UUID) -> Documents:
    """The results' documents by camera, model and fold, without the times they took."""
    rows = session.scalars(select(Result).where(Result.calibration_id == calibration_id))
    return {
        (row.camera, row.model, row.fold): {k: v for k, v in row.document.items() if k not in _TIMES} for row in rows
    }


def slot_bests(session: Session, calibration_id: UUID) -> set[tuple[Any, ...]]:
    """Every slot's best: camera, model, fold, iteration, slot, evaluations, loss, parameters."""
    rows = session.execute(
        select(CalibrationRun, Slot)
        .join(Slot, Slot.run_id == CalibrationRun.id)
        .where(CalibrationRun.calibration_id == calibration_id)
    )
    return {
        (run.camera, run.model, run.fold, slot.iteration, slot.slot, slot.evaluations, slot.loss, *slot.parameters)
        for run, slot in rows
    }
