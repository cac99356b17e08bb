"""What decides a vehicle's calibration and who may see it, read for many requests by one statement of look-ups."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from hashlib import sha256
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import (
    ARRAY,
    Connection,
    Dialect,
    Select,
    String,
    Uuid,
    and_,
    bindparam,
    column,
    func,
    select,
    type_coerce,
)

from apexcal.documents.publications import CURRENT
from service.auth.secrets import secret_hash
from service.db.aliases import AliasMove, Withdrawal
from service.db.calibrations import NEWNESS, Calibration, Publication, Result
from service.db.clock import utc_now
from service.db.fleets import Rig, RigCamera, Vehicle
from service.db.people import ApiToken, Membership, Person


class Look(NamedTuple):
    """Whose token asks, for which vehicle, under which alias. Without a token only the vehicle is looked at."""

    secret: str
    vehicle_id: UUID
    alias: str


class Seen(NamedTuple):
    """Whether the token is known, and may see the vehicle; the vehicle's fleet, None where there is no such vehicle;
    and a digest of all that decides the answer.
    """

    is_known: bool
    may_see: bool
    fleet_id: UUID | None
    digest: str


def _statement(dialect: str, alias: str) -> Select[*tuple[Any, ...]]:
    """Rows (place of the question; token's state; membership; vehicle's state), one for each camera of each rig.

    For an alias its last move stands in place of the publication.
    """
    if dialect == "sqlite":
        each = func.json_each(bindparam("questions")).table_valued("key", "value")
        place, digest = each.c.key, func.json_extract(each.c.value, "$[0]")
        vehicle_id = type_coerce(func.json_extract(each.c.value, "$[1]"), Uuid())
        questions: Any = each
    else:
        questions = func.unnest(
            bindparam("hashes", type_=ARRAY(String())), bindparam("vehicles", type_=ARRAY(Uuid()))
        ).table_valued(column("digest", String()), column("vehicle_id", Uuid()), with_ordinality="place")
        questions = questions.render_derived()
        place, digest, vehicle_id = questions.c.place - 1, questions.c.digest, questions.c.vehicle_id
    decided = _of_current() if alias == CURRENT else _of_alias()
    in_fleet = and_(Membership.person_id == Person.id, Membership.fleet_id == Vehicle.fleet_id)
    return (
        select(
            *(place, ApiToken.id, ApiToken.fleet_id, ApiToken.expires_at, Person.is_owner, Membership.role),
            *(Vehicle.id, Vehicle.fleet_id, Vehicle.version, Rig.id, Rig.version, RigCamera.name, *decided),
        )
        .select_from(questions)
        .outerjoin(ApiToken, and_(ApiToken.secret_hash == digest, ApiToken.revoked_at.is_(None)))
        .outerjoin(Person, Person.id == ApiToken.person_id)
        .outerjoin(Vehicle, Vehicle.id == vehicle_id)
        .outerjoin(Membership, in_fleet)
        .outerjoin(Rig, Rig.vehicle_id == Vehicle.id)
        .outerjoin(RigCamera, RigCamera.rig_id == Rig.id)
    )


# How many columns say who asks, before those that decide the answer.
_WHO = 6


def _of_current() -> tuple[Any, Any, Any]:
    of_camera = (Publication.vehicle_id == Vehicle.id, Publication.camera == RigCamera.name)
    newest = select(Publication.id).where(*of_camera).order_by(*(key.desc() for key in NEWNESS)).limit(1)
    withdrawn = (Withdrawal.vehicle_id == Vehicle.id, Withdrawal.camera == RigCamera.name)
    last = _for_each(select(func.max(Withdrawal.number)).where(*withdrawn))
    return _for_each(newest), last, _for_each(_end_of(Publication, newest))


def _of_alias() -> tuple[Any, Any, Any]:
    of_camera = (AliasMove.vehicle_id == Vehicle.id, AliasMove.camera == RigCamera.name)
    moves = select(AliasMove.id).where(*of_camera, AliasMove.alias == bindparam("alias"))
    newest = moves.order_by(AliasMove.number.desc()).limit(1)
    # A result that is deleted leaves its move.
    result = _for_each(newest.with_only_columns(AliasMove.result_id))
    return _for_each(newest), result, _for_each(_end_of(AliasMove, newest))


def _end_of(move: Any, newest: Select[Any]) -> Select[Any]:
    """When the calibration ended that the newest comes from: what is told of its quality is known since."""
    ended = select(Calibration.finished_at).select_from(move).join(Result, Result.id == move.result_id)
    return ended.join(Calibration, Calibration.id == Result.calibration_id).where(move.id == _for_each(newest))


def _for_each(statement: Select[Any]) -> Any:
    return statement.correlate(Vehicle, RigCamera).scalar_subquery()


# Built once: SQLAlchemy takes longer to build such a statement than to run it.
_STATEMENTS = {
    (dialect, alias == CURRENT): _statement(dialect, alias)
    for dialect in ("sqlite", "postgresql")
    for alias in (CURRENT, "")
}


def read_states(connection: Connection, alias: str, looks: Sequence[Look], cursor: Any = None) -> list[Seen]:
    """What is there now for each look, all of one alias, in their order.

    ``cursor``: of PostgreSQL's driver, for callers that read often, because SQLAlchemy takes three times as long.
    Then it raises the driver's errors.
    """
    dialect = connection.dialect.name
    hashes = [secret_hash(look.secret) for look in looks]
    given: dict[str, Any] = {} if alias == CURRENT else {"alias": alias}
    if dialect == "sqlite":
        pairs = zip(hashes, (look.vehicle_id.hex for look in looks), strict=True)
        given["questions"] = json.dumps(list(pairs))
    else:
        given |= {"hashes": hashes, "vehicles": [look.vehicle_id for look in looks]}
    if cursor is None:
        rows: Iterable[Sequence[Any]] = connection.execute(_STATEMENTS[dialect, alias == CURRENT], given)
    else:
        spoken = _Spoken.of(connection.dialect, alias == CURRENT)
        rows = map(spoken.as_read, cursor.execute(spoken.text, {**spoken.values, **given}, prepare=True))
    found: list[list[Sequence[Any]]] = [[] for _ in looks]
    for row in rows:
        found[row[0]].append(tuple(row))
    return [_seen(rows) for rows in found]


class _Spoken(NamedTuple):
    """A statement as the driver takes it: its text, its constant values, and what its types make of a row."""

    text: str
    values: Mapping[str, Any]
    processors: tuple[tuple[int, Callable[[Any], Any]], ...]

    @staticmethod
    @lru_cache(maxsize=4)
    def of(dialect: Dialect, is_current: bool) -> _Spoken:
        """The statement in this dialect."""
        statement = _STATEMENTS[dialect.name, is_current]
        compiled = statement.compile(dialect=dialect)
        made = (
            (i, c.type.dialect_impl(dialect).result_processor(dialect, None))
            for i, c in enumerate(statement.selected_columns)
        )
        return _Spoken(str(compiled), compiled.params, tuple((i, one) for i, one in made if one))

    def as_read(self, row: Sequence[Any]) -> list[Any]:
        """The row as SQLAlchemy would give it."""
        read = list(row)
        for place, process in self.processors:
            read[place] = process(read[place])
        return read


def _seen(rows: Sequence[Sequence[Any]]) -> Seen:
    _, token_id, only_fleet, expires_at, is_owner, role, vehicle_id, fleet_id, *_ = rows[0]
    is_known = token_id is not None and not (expires_at is not None and expires_at <= utc_now())
    may_see = is_known and only_fleet in (None, fleet_id) and (is_owner or role is not None)
    if vehicle_id is None:
        return Seen(is_known, False, None, "")
    # Sorted here, because the statement has no ORDER BY.
    state = sorted(repr(row[_WHO:]) for row in rows)
    return Seen(is_known, may_see, fleet_id, sha256("\n".join(state).encode()).hexdigest())
