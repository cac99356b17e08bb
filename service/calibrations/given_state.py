"""What decides a vehicle's calibration and who may see it, read for many requests by one statement of look-ups."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from typing import TYPE_CHECKING, Any, NamedTuple
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
    cast,
    column,
    func,
    or_,
    select,
    type_coerce,
)

from apexcal.documents.publications import CURRENT
from service.auth.secrets import secret_hash
from service.db.aliases import AliasMove, Withdrawal
from service.db.calibrations import NEWNESS, Calibration, Publication, Result
from service.db.clock import now
from service.db.fleets import Rig, RigCamera, Vehicle
from service.db.people import ApiToken, Membership, Person

if TYPE_CHECKING:
    from psycopg.pq.abc import PGresult

_Row = tuple[int, bool, bool, UUID | None, str]


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
    """Rows (place of the question; whether the token is known, and may see the vehicle; the vehicle's fleet; as text
    what decides the answer), one for each camera of each rig.

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
    state = (Vehicle.id, Vehicle.fleet_id, Vehicle.version, Rig.id, Rig.version, RigCamera.name, *decided)
    # A text, so that each way of reading it gives the same digest.
    as_text = func.json_array(*state) if dialect == "sqlite" else cast(func.json_build_array(*state), String)
    may_see = and_(
        ApiToken.id.is_not(None),
        or_(ApiToken.fleet_id.is_(None), ApiToken.fleet_id == Vehicle.fleet_id),
        or_(Person.is_owner, Membership.role.is_not(None)),
    )
    holds = or_(ApiToken.expires_at.is_(None), ApiToken.expires_at > now())
    in_fleet = and_(Membership.person_id == Person.id, Membership.fleet_id == Vehicle.fleet_id)
    return (
        select(place, ApiToken.id.is_not(None), may_see, Vehicle.fleet_id, as_text)
        .select_from(questions)
        .outerjoin(ApiToken, and_(ApiToken.secret_hash == digest, ApiToken.revoked_at.is_(None), holds))
        .outerjoin(Person, Person.id == ApiToken.person_id)
        .outerjoin(Vehicle, Vehicle.id == vehicle_id)
        .outerjoin(Membership, in_fleet)
        .outerjoin(Rig, Rig.vehicle_id == Vehicle.id)
        .outerjoin(RigCamera, RigCamera.rig_id == Rig.id)
    )


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


def read_states(connection: Connection, alias: str, looks: Sequence[Look]) -> list[Seen]:
    """What is there now for each look, all of one alias, in their order."""
    dialect = connection.dialect.name
    hashes = [secret_hash(look.secret) for look in looks]
    given: dict[str, Any] = {} if alias == CURRENT else {"alias": alias}
    if dialect == "sqlite":
        pairs = zip(hashes, (look.vehicle_id.hex for look in looks), strict=True)
        given["questions"] = json.dumps(list(pairs))
    else:
        given |= {"hashes": hashes, "vehicles": [look.vehicle_id for look in looks]}
    rows = connection.execute(_STATEMENTS[dialect, alias == CURRENT], given)
    return _of_rows(len(looks), ((row[0], bool(row[1]), bool(row[2]), row[3], row[4]) for row in rows))


class Prepared(NamedTuple):
    """A statement as PostgreSQL prepares it, with ``$1`` for its first value, and its values."""

    text: str
    constants: Mapping[str, Any]

    @staticmethod
    def of(dialect: Dialect, is_current: bool) -> Prepared:
        """The statement for many looks, in the dialect of psycopg, which writes ``%(name)s`` for a value."""
        compiled = _STATEMENTS[dialect.name, is_current].compile(dialect=dialect)
        numbered = {name: f"${number}" for number, name in enumerate(compiled.params, 1)}
        return Prepared(str(compiled) % numbered, compiled.params)

    def values(self, alias: str, looks: Sequence[Look]) -> list[bytes]:
        """The values of ``$1`` and so on for these looks, all of one alias."""
        hashes = ",".join(secret_hash(look.secret) for look in looks)
        vehicles = ",".join(str(look.vehicle_id) for look in looks)
        given = {**self.constants, "alias": alias, "hashes": f"{{{hashes}}}", "vehicles": f"{{{vehicles}}}"}
        return [str(given[name]).encode() for name in self.constants]

    @staticmethod
    def seen(count: int, found: PGresult) -> list[Seen]:
        """What PostgreSQL answered about so many looks."""

        def rows() -> Iterator[_Row]:
            for row in range(found.ntuples):
                place, is_known, may_see, fleet_id, state = (found.get_value(row, i) or b"" for i in range(5))
                fleet = UUID(fleet_id.decode()) if fleet_id else None
                yield int(place), is_known == b"t", may_see == b"t", fleet, state.decode()

        return _of_rows(count, rows())


def _of_rows(count: int, rows: Iterable[_Row]) -> list[Seen]:
    """What is there for each of so many looks; each has a row at least."""
    found: list[list[_Row]] = [[] for _ in range(count)]
    for row in rows:
        found[row[0]].append(row)
    return [_seen(rows) for rows in found]


def _seen(rows: Sequence[_Row]) -> Seen:
    _, is_known, may_see, fleet_id, _ = rows[0]
    if fleet_id is None:
        return Seen(is_known, False, None, "")
    # Sorted here, because the statement has no ORDER BY.
    state = sorted(row[4] for row in rows)
    return Seen(is_known, may_see, fleet_id, sha256("\n".join(state).encode()).hexdigest())
