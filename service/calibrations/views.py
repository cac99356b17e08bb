"""Calibrations and results, as the answers show them.

Slots come in pages: their key is three columns, so the cursor is too.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import Select, select, tuple_
from sqlalchemy.orm import Session

from apexcal.documents.calibrations import CalibrationView, ProgressView, RunView, SlotView
from apexcal.documents.checks import Check, verdict_of
from apexcal.documents.pairs import CORNER
from apexcal.documents.results import SINGLE_HELD_OUT_PAIRS
from apexcal.documents.states import UNENDED
from service.platform.db.base import Json
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Result, Slot
from service.platform.http.pages import Page, Window, invalid_cursor
from service.platform.http.problems import not_found


def origin_of(session: Session, result: Result) -> tuple[CalibrationRun, Calibration, CorrespondenceSet]:
    """What a result was fitted in and to. Raises :class:`Problem` 404 where it is deleted at this moment."""
    row = session.execute(
        select(CalibrationRun, Calibration, CorrespondenceSet)
        .join(Calibration, Calibration.id == CalibrationRun.calibration_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CalibrationRun.id == result.run_id)
    ).one_or_none()
    if row is None:
        raise not_found()
    run, calibration, pairs = row
    return run, calibration, pairs


def calibration_views(
    session: Session, rows: Sequence[Calibration], *, with_pairs: bool = False, with_notes: bool = True
) -> list[CalibrationView]:
    """Calibrations with their runs; ``with_pairs`` also with the vertices that two cameras put apart.

    ``with_notes``: notes repeat those of the sets, which say what people answered.
    """
    runs: dict[UUID, list[CalibrationRun]] = defaultdict(list)
    statement = select(CalibrationRun).order_by(CalibrationRun.camera, CalibrationRun.model, CalibrationRun.fold)
    for run in session.scalars(statement.where(CalibrationRun.calibration_id.in_([row.id for row in rows]))):
        runs[run.calibration_id].append(run)
    return [
        _calibration_view(row, runs[row.id], with_pairs=with_pairs).model_copy(
            update={} if with_notes else {"notes": []}
        )
        for row in rows
    ]


def _calibration_view(row: Calibration, runs: list[CalibrationRun], *, with_pairs: bool) -> CalibrationView:
    return CalibrationView.of(
        row,
        progress=_progress(row, runs),
        runs=[
            RunView.of(run, best_loss=(run.search_state or {}).get("best_loss"), failure=run.problem) for run in runs
        ],
        summary=row.summary if with_pairs else _without_vertices(row.summary),
    )


def vertices_apart(summary: Json | None) -> list[Json]:
    """What the comparison of two cameras says of single vertices, a list for each two that share some."""
    shared = [pair.get("shared") for pair in ((summary or {}).get("rig") or {}).get("pairs", [])]
    return [comparison["odd"] for comparison in shared if comparison and comparison["odd"]]


def _without_vertices(summary: Json | None) -> Json | None:
    if summary is None or not vertices_apart(summary):
        return summary
    pairs = [pair | {"shared": pair["shared"] and pair["shared"] | {"odd": []}} for pair in summary["rig"]["pairs"]]
    return summary | {"rig": summary["rig"] | {"pairs": pairs}}


def _progress(row: Calibration, runs: Sequence[CalibrationRun]) -> ProgressView:
    """Ended fits count whole; a running one approaches a whole, for nobody knows when its narrowing stops."""
    ended = sum(run.state not in UNENDED for run in runs)
    begun = sum(run.iteration / (run.iteration + 10.0) for run in runs if run.state in UNENDED)
    fraction = (ended + begun) / len(runs) if runs else 1.0
    judging = row.state in UNENDED and ended == len(runs)
    message = "the models are compared" if judging else f"{ended} of {len(runs)} fits have ended"
    return ProgressView(fraction=round(fraction, 4), message=message)


def result_document(
    row: Result,
    run: CalibrationRun,
    calibration: Calibration,
    pairs: CorrespondenceSet,
    checks: Sequence[Check] | None,
    *,
    with_pairs: bool,
) -> Json:
    """The published document, which rows it belongs to, all its ``checks``, and where its outliers come from.

    ``with_pairs``: whether the reader may know how far single marks lie from where their vertices project. With the
    calibration beside it that is to know the marks.
    """
    document = row.published_document if with_pairs else _without_pairs(row.published_document)
    outliers: list[Json] = document["outliers"]
    # In a fit without a held-out block, indices count the remaining pairs.
    if row.fold == FULL:
        outliers = [outlier | {"pair": _origin(pairs, outlier["index"])} for outlier in outliers]
    return document | {
        "outliers": outliers,
        "checks": document["checks"] if checks is None else [check.model_dump(mode="json") for check in checks],
        "verdict": None if checks is None else verdict_of(checks, "mount_with_lens"),
        "verdict_alone": None if checks is None else verdict_of(checks, "mount_alone"),
        "recording_id": str(pairs.recording_id) if pairs.recording_id else None,
        "detection_id": str(pairs.detection_id) if pairs.detection_id else None,
        "id": str(row.id),
        "fleet_id": str(row.fleet_id),
        "vehicle_id": str(calibration.vehicle_id),
        "rig_id": str(calibration.rig_id),
        "calibration_id": str(row.calibration_id),
        "run_id": str(row.run_id),
        "set_id": str(run.set_id),
        "camera": row.camera,
        "model": row.model,
        "fold": row.fold,
        "seed": run.fit_request["seed"],
        "created_at": row.created_at,
    }


def _without_pairs(document: Json) -> Json:
    """A result without what it says of single pairs; its numbers over all pairs stay."""
    heldout: Json | None = document.get("heldout")
    over_all = heldout and heldout | dict.fromkeys(SINGLE_HELD_OUT_PAIRS)
    return document | {"outliers": [], "residuals_px": None, "heldout": over_all}


def _origin(pairs: CorrespondenceSet, index: int) -> Json:
    """What a set knows of one of its pairs: its stamp, sweep, camera frame or pose, corner, and the mark."""
    names = ("stamp_ns", "sweep_index", "frame_index", "group", CORNER, "u", "v")
    return {name: pairs.columns[name][index] for name in names if name in pairs.columns}


def slot_page(session: Session, statement: Select[CalibrationRun, Slot], window: Window) -> Page[SlotView]:
    """One page of a query for (CalibrationRun, Slot), run by run, in the order of iterations and slots."""
    key = (Slot.run_id, Slot.iteration, Slot.slot)
    if window.after is not None:
        statement = statement.where(tuple_(*key) > tuple_(*_parse(window.after)))
    rows = session.execute(statement.order_by(*key).limit(window.limit + 1)).all()
    following = None
    if len(rows) > window.limit:
        rows = rows[: window.limit]
        last: Slot = rows[-1][1]
        following = f"{last.run_id.hex}.{last.iteration}.{last.slot}"
    items = [SlotView.of(slot, camera=run.camera, model=run.model, fold=run.fold) for run, slot in rows]
    return Page(items=items, next=following)


def _parse(cursor: str) -> tuple[UUID, int, int]:
    try:
        run_id, iteration, slot = cursor.split(".")
        key = UUID(hex=run_id), int(iteration), int(slot)
        if not all(0 <= number < 2**31 for number in key[1:]):
            raise ValueError(cursor)
        return key
    except ValueError:
        raise invalid_cursor(cursor) from None
