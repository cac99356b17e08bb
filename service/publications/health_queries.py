"""The health of a fleet by one statement: each camera's state, as the checks and publications say it now.

An index finds a camera's newest publication, calibration and recording, however long its history. Counts and page
come from the same rows.
"""

from __future__ import annotations

import json
from base64 import urlsafe_b64decode, urlsafe_b64encode
from collections.abc import Sequence
from typing import Any, Final
from uuid import UUID

from sqlalchemy import (
    CTE,
    BigInteger,
    ColumnElement,
    Double,
    ScalarSelect,
    and_,
    case,
    exists,
    func,
    literal,
    null,
    or_,
    select,
    true,
    tuple_,
    type_coerce,
)
from sqlalchemy.orm import InstrumentedAttribute, Session

from apexcal.documents.fleet_health import CameraHealth, FleetHealth
from apexcal.documents.publications import CURRENT
from apexcal.documents.states import UNENDED, CameraState, CameraWork, RecordingState, WorkState
from service.platform.db.base import state_literal
from service.platform.db.calibrations import Calibration, CalibrationRun, Publication, Result, newest_move
from service.platform.db.fleets import Rig, RigCamera, RigLidar, Vehicle
from service.platform.db.recordings import Recording
from service.platform.http.pages import Window, invalid_cursor
from service.publications.actions import PUBLISHED_LOOKS

_GRAVITY: Final = {state.value: index for index, state in enumerate(CameraState)}
_URGENCY: Final = {work.value: index for index, work in enumerate(CameraWork)}


def fleet_health(
    session: Session,
    fleet_id: UUID,
    window: Window | None,
    sought: str = "",
    states: Sequence[CameraState] = (),
    works: Sequence[CameraWork] = (),
    order: str = "vehicle",
) -> FleetHealth:
    """Return a page of the cameras of a fleet; all of them without a window.

    ``sought`` is a part of the vehicle's or camera's name. ``order`` names a member, ``-`` before it turns it round.
    Raises :class:`Problem` 422 ``invalid_cursor``.
    """
    cameras = _cameras(fleet_id)
    names = (cameras.c.vehicle, cameras.c.camera_name)
    matches = or_(*(name.icontains(sought, autoescape=True) for name in names)) if sought else true()
    kinds = (cameras.c.state.label("of_state"), cameras.c.work.label("of_work"))
    kind = func.coalesce(cameras.c.state, "").concat(cameras.c.work).label("kind")
    counts = select(kind, *kinds, func.count(cameras.c.camera).label("cameras")).where(matches)
    by_kind = counts.group_by(kind, *kinds).cte("counts")
    key, is_turned = _key(cameras, order.removeprefix("-")), order.startswith("-")
    # Rows with the same key are sorted by names. The id keeps vehicles apart whose sort names are equal.
    ties = (cameras.c.sort_name, cameras.c.vehicle_id, cameras.c.camera_name)
    rows = select(cameras, key.label("key")).where(matches)
    if states:
        rows = rows.where(cameras.c.state.in_(states))
    if works:
        rows = rows.where(cameras.c.work.in_(works))
    if window is not None:
        if window.after is not None:
            edge, *tie = _parse(window.after, key.type.python_type)
            beyond = key < edge if is_turned else key > edge
            rows = rows.where(or_(beyond, and_(key == edge, tuple_(*ties) > tuple_(*map(literal, tie)))))
        rows = rows.order_by(key.desc() if is_turned else key, *ties).limit(window.limit + 1)
    page = rows.cte("page")
    # The page's rows are joined to the first count, so an empty page leaves all counts in the answer.
    first = select(func.min(by_kind.c.kind)).scalar_subquery()
    beside = by_kind.outerjoin(page, by_kind.c.kind == first)
    in_order = (page.c.key.desc() if is_turned else page.c.key, *(page.c[column.name] for column in ties))
    answer = session.execute(select(*_shown(page), by_kind).select_from(beside).order_by(*in_order)).all()
    items = [row for row in answer if row.vehicle_id is not None]
    following = None
    if window is not None and len(items) > window.limit:
        items = items[: window.limit]
        last = items[-1]
        edges = [last.key, last.sort_name, last.vehicle_id.hex, last.camera_name]
        following = urlsafe_b64encode(json.dumps(edges).encode()).decode()
    sizes = {(row.of_state, row.of_work): row.cameras for row in answer}
    wanted_states, wanted_works = set(states or CameraState), set(works or CameraWork)
    return FleetHealth(
        items=[CameraHealth.model_validate(row) for row in items],
        next=following,
        matching=sum(sizes.get((state, work), 0) for state in wanted_states for work in wanted_works),
        counts={state: sum(sizes.get((state, work), 0) for work in wanted_works) for state in CameraState},
        work_counts={work: sum(sizes.get((state, work), 0) for state in wanted_states) for work in CameraWork},
    )


def _key(cameras: CTE, order: str) -> ColumnElement[Any]:
    """Return the sort key of an order; missing values sort first."""
    if order == "vehicle":
        return cameras.c.sort_name
    if order == "state":
        return func.coalesce(case(_GRAVITY, value=cameras.c.state), len(_GRAVITY))
    if order == "work":
        return case(_URGENCY, value=cameras.c.work)
    if order == "error_20m_mm":
        return type_coerce(func.coalesce(cameras.c.error_20m_mm, -1.0), Double())
    moment = _newest_recording(cameras, Recording.created_at) if order == "recorded_at" else cameras.c.published_at
    return func.coalesce(type_coerce(moment, BigInteger), 0)


def _parse(cursor: str, kind: type[Any]) -> tuple[Any, str, UUID, str]:
    try:
        key, name, vehicle_id, camera = json.loads(urlsafe_b64decode(cursor.encode()))
        if not (type(key) is kind and type(name) is type(camera) is str and "\0" not in f"{key}{name}{camera}"):
            raise ValueError(cursor)
        if kind is int and abs(key) >= 2**63:
            raise ValueError(cursor)
        return key, name, UUID(vehicle_id), camera
    except (ValueError, TypeError, AttributeError):
        raise invalid_cursor(cursor) from None


def _shown(page: CTE) -> Sequence[ColumnElement[Any]]:
    """Return a page's columns, with two that its rows alone need: newest recording and calibration to look at."""
    row = page.c
    newest_id, newest_state = _newest_calibration(page, Calibration.id), _newest_calibration(page, Calibration.state)
    return (
        *row,
        _newest_recording(page, Recording.id).label("recording_id"),
        _newest_recording(page, Recording.created_at).label("recorded_at"),
        case((or_(newest_state.in_(UNENDED), _is_open(page)), newest_id), else_=row.published_id).label(
            "calibration_id"
        ),
    )


def _is_open(cameras: CTE) -> ColumnElement[bool]:
    """Whether the newest calibration could be published, and since its end nothing was published or withdrawn."""
    ended_at = type_coerce(_newest_calibration(cameras, Calibration.finished_at), BigInteger)
    return and_(
        _newest_calibration(cameras, Calibration.state) == WorkState.DONE,
        _newest_calibration(cameras, Calibration.id).is_distinct_from(cameras.c.published_id),
        ended_at > func.coalesce(type_coerce(cameras.c.published_at, BigInteger), 0),
    )


def _work(mounts: CTE) -> ColumnElement[Any]:
    """Return what each camera waits for."""
    mount = mounts.c
    # A calibration that ended after the publication, and that its checks kept from being published.
    of_run = (CalibrationRun.calibration_id == Calibration.id, CalibrationRun.camera == mount.camera)
    is_withheld = exists().where(
        *(Calibration.vehicle_id == mount.vehicle_id, Calibration.state == state_literal(WorkState.DONE)),
        *(Calibration.finished_at > mount.published_at, Calibration.id != mount.published_id),
        *(Calibration.publish == "recommended", exists().where(*of_run).correlate(Calibration, mounts)),
    )
    is_used = and_(mount.result_id.is_not(None), mount.is_swapped_since == 0)
    is_undecided = or_(mount.verdict.is_(None), mount.is_undecided, is_withheld.correlate(mounts))
    return case(
        (_newest_calibration(mounts, Calibration.state).in_(UNENDED), CameraWork.RUNNING),
        (and_(is_used, is_undecided), CameraWork.DECISION),
        (is_used, CameraWork.NOTHING),
        (_is_open(mounts), CameraWork.DECISION),
        (_newest_recording(mounts, Recording.id).is_(None), CameraWork.RECORDING),
        else_=CameraWork.MARKS,
    )


def _newest_calibration(cameras: CTE, column: InstrumentedAttribute[Any]) -> ScalarSelect[Any]:
    """A column of the newest calibration of a camera."""
    of_run = (CalibrationRun.calibration_id == Calibration.id, CalibrationRun.camera == cameras.c.camera)
    return (
        select(column)
        .where(Calibration.vehicle_id == cameras.c.vehicle_id)
        .where(exists().where(*of_run).correlate(Calibration, cameras))
        .order_by(Calibration.created_at.desc())
        .limit(1)
        .correlate(cameras)
        .scalar_subquery()
    )


def _newest_recording(cameras: CTE, column: InstrumentedAttribute[Any]) -> ScalarSelect[Any]:
    """A column of the newest ready recording of a camera's rig."""
    return (
        select(column)
        .where(Recording.rig_id == cameras.c.rig_id, Recording.state == state_literal(RecordingState.READY))
        .order_by(Recording.id.desc())
        .limit(1)
        .correlate(cameras)
        .scalar_subquery()
    )


def _cameras(fleet_id: UUID) -> CTE:
    """A row for each camera that a vehicle of the fleet carries now, and one for each vehicle without a camera."""
    mounts = _judged(_mounts(fleet_id))
    mount = mounts.c
    state = case(
        (mount.camera.is_(None), null()),
        (and_(mount.result_id.is_(None), mount.number.is_not(None), mount.led_to.is_(None)), CameraState.WITHDRAWN),
        (mount.result_id.is_(None), CameraState.NONE),
        else_=CameraState.PUBLISHED,
    )
    described = exists().where(Rig.vehicle_id == mount.vehicle_id, RigCamera.rig_id == Rig.id)
    is_carried = and_(mount.camera.is_not(None), mount.rig_age == 1)
    return (
        select(
            *(mount.vehicle_id, mount.vehicle, mount.sort_name, mount.camera, mount.rig_id),
            func.coalesce(mount.camera, "").label("camera_name"),
            *(mount.verdict, mount.error_20m_mm, mount.published_at, mount.published_id),
            *(state.label("state"), _work(mounts).label("work")),
            (mount.is_swapped_since == 1).label("is_swapped"),
        )
        .where(mount.age == 1, or_(is_carried, and_(mount.camera.is_(None), ~described)))
        .cte("cameras")
    )


def _judged(mounts: CTE) -> CTE:
    """Return the mounts with their cameras' publications. ``age`` is 1 for the mount that counts now for a camera.

    ``is_swapped_since`` is 1 if the published result is of a mount with a sensor that was swapped.
    """
    of_camera = (mounts.c.vehicle_id, mounts.c.camera)
    newest_first = (mounts.c.rig_age, mounts.c.rig_created_at.desc(), mounts.c.rig_id.desc())
    is_calibrated_one = Calibration.rig_id == mounts.c.rig_id
    return (
        select(
            mounts,
            *(Publication.number, Publication.result_id, Publication.led_to),
            *(Result.verdict, Result.error_20m_mm, Publication.created_at.label("published_at")),
            Result.calibration_id.label("published_id"),
            # Nobody decided that it be used in spite of its checks.
            and_(
                Result.verdict != "pass",
                or_(Publication.overridden.is_(null()), Publication.reason == PUBLISHED_LOOKS),
            ).label("is_undecided"),
            func.max(case((and_(is_calibrated_one, mounts.c.is_swapped), 1), else_=0))
            .over(partition_by=of_camera)
            .label("is_swapped_since"),
            func.row_number().over(partition_by=of_camera, order_by=newest_first).label("age"),
        )
        .select_from(mounts)
        .outerjoin(Publication, Publication.id == mounts.c.publication_id)
        .outerjoin(Result, Result.id == Publication.result_id)
        .outerjoin(Calibration, Calibration.id == Result.calibration_id)
        .cte("judged")
    )


def _mounts(fleet_id: UUID) -> CTE:
    """Select each camera of each rig of the fleet, and a row without a camera for vehicles that have none.

    ``rig_age`` is 1 for the newest rig of its LiDAR. ``is_swapped``: the newest rig that states the serial number of
    the camera, or of this LiDAR, states another one. A sensor without a serial number counts as not swapped.
    """
    newest_first = (Rig.created_at.desc(), Rig.id.desc())
    of_lidar = (Vehicle.id, RigLidar.frame)
    of_camera = (Vehicle.id, RigCamera.name)
    lidar_now = func.first_value(RigLidar.serial).over(
        partition_by=of_lidar, order_by=(RigLidar.serial.is_(None), *newest_first)
    )
    camera_now = func.first_value(RigCamera.serial).over(
        partition_by=of_camera, order_by=(RigCamera.serial.is_(None), *newest_first)
    )
    age = func.rank().over(partition_by=of_lidar, order_by=(RigCamera.id.is_(None), *newest_first))
    move_id = newest_move(Vehicle.id, RigCamera.name, CURRENT).correlate(Vehicle, RigCamera)
    rows = (
        select(
            *(Vehicle.id.label("vehicle_id"), Vehicle.name.label("vehicle"), Vehicle.sort_name),
            *(Rig.id.label("rig_id"), Rig.created_at.label("rig_created_at"), RigCamera.name.label("camera")),
            age.label("rig_age"),
            or_(RigLidar.serial != lidar_now, RigCamera.serial != camera_now).label("is_swapped"),
            move_id.scalar_subquery().label("publication_id"),
        )
        .select_from(Vehicle)
        .outerjoin(Rig, Rig.vehicle_id == Vehicle.id)
        .outerjoin(RigLidar, RigLidar.rig_id == Rig.id)
        .outerjoin(RigCamera, RigCamera.rig_id == Rig.id)
        .where(Vehicle.fleet_id == fleet_id)
        .cte("mounts")
    )
    # Without this PostgreSQL looks each publication up twice: for the join, and again for the joined rows.
    return rows.prefix_with("MATERIALIZED", dialect="postgresql")
