"""Validations: a calibration held against other pairs, or against a drive."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from service.db.calibrations import CorrespondenceSet
from service.db.validations import Validation
from service.jobs.claims import Claim, Lease
from workers.tasks.context import Context
from workers.validation.calibration import KnownCalibration
from workers.validation.pair_score import score_pairs as score


def score_pairs(context: Context, held: Claim, lease: Lease) -> Callable[[Session], None]:
    """Errors of a calibration on a set's pairs, without a fit."""
    lease.report(0.0, "scoring pairs")
    with context.database.reading() as session:
        row = session.get_one(Validation, held.subject_id)
        calibration = KnownCalibration.of(row.asked["calibration"])
        columns = session.get_one(CorrespondenceSet, row.set_id).pairs
    points = np.column_stack([columns[name] for name in "xyz"]).astype(np.float64)
    marks = np.column_stack([columns[name] for name in "uv"]).astype(np.float64)
    return _writing(held, score(calibration, points, marks))


def _writing(held: Claim, result: dict[str, Any]) -> Callable[[Session], None]:
    def write(session: Session) -> None:
        session.get_one(Validation, held.subject_id).result = result

    return write
