"""The verdict of a report on a calibration by the product's own path, and on other pairs than it was fitted to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.checks import Check
from apexcal.geometry.rotations import rotation_from_vector
from apexcal.geometry.se3 import SE3, from_document, to_document
from benchmarks.coverage.calibrations import Bench, Calibration
from benchmarks.coverage.marks import Errors
from benchmarks.coverage.walks import Paired
from workers.judge.calibration_checks import checks_of_calibration
from workers.reports.material import FittedModel
from workers.reports.verdict import ReportVerdict, sentence_of
from workers.simulation.camera import FRONT
from workers.validation.calibration import KnownCalibration
from workers.validation.pair_score import score_pairs

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Judged:
    """A calibration, its verdict, and the checks that failed."""

    done: Calibration
    fitted: FittedModel
    verdict: ReportVerdict
    failed: frozenset[str]


def judge(bench: Bench, paired: Paired, known: dict[str, Any], request: dict[str, Any]) -> Judged:
    """Calibrate and judge as a report does. The request names one model."""
    done = bench.fit(paired, Errors(), known, request)
    (model,) = request["models"]
    fitted = FittedModel(model, done.results[model], done.problems[model])
    checks = [Check.model_validate(one) for one in fitted.document["checks"]]
    checks += checks_of_calibration(
        fitted.document, checks=checks, camera=FRONT, summary=done.summary, ended_well=True
    )
    failed = frozenset(one.name for one in checks if one.verdict != "pass")
    return Judged(done, fitted, sentence_of(fitted.document, checks), failed)


def agrees_elsewhere(found: Judged, others: dict[str, Any], turn: Floats, shift: Floats) -> bool:
    """Whether the result agrees with other pairs, if its mount moved by a turn (rad) and a shift (m) before these."""
    document = dict(found.fitted.document)
    mount = from_document(document["transform"])
    R = rotation_from_vector(turn)
    moved = SE3(mount.to_frame, mount.from_frame, R @ mount.R, mount.t + shift)
    document["transform"] = to_document(moved)
    points, marks = (np.column_stack([others[name] for name in names]) for names in ("xyz", "uv"))
    return score_pairs(KnownCalibration.of(document), points, marks)["verdict"] == "agrees"
