"""What decides a vehicle's calibration and who may see it, read for many requests by one statement.

The statement looks rows up by indexes. A request waits for a statement that begins after it came, so no answer is
older than the request. While one runs, further requests gather for the next. Nothing is kept between two statements,
so the next one sees every change, whoever made it.
"""

from __future__ import annotations

import asyncio
import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import ARRAY, Connection, Select, String, Uuid, and_, bindparam, column, func, select, type_coerce
from sqlalchemy.exc import DBAPIError

from apexcal.documents.publications import CURRENT
from service.auth.secrets import secret_hash
from service.db.aliases import AliasMove, Withdrawal
from service.db.calibrations import NEWNESS, Calibration, Publication, Result
from service.db.clock import utc_now
from service.db.fleets import Rig, RigCamera, Vehicle
from service.db.people import ApiToken, Membership, Person
from service.db.session import Database

# Statements under way at once: one is read while the next is sent.
_AT_ONCE = 2
_MOST = 64


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
    found: list[list[tuple[Any, ...]]] = [[] for _ in looks]
    for row in connection.execute(_STATEMENTS[dialect, alias == CURRENT], given):
        found[row[0]].append(tuple(row))
    return [_seen(rows) for rows in found]


def _seen(rows: Sequence[tuple[Any, ...]]) -> Seen:
    _, token_id, only_fleet, expires_at, is_owner, role, vehicle_id, fleet_id, *_ = rows[0]
    is_known = token_id is not None and not (expires_at is not None and expires_at <= utc_now())
    may_see = is_known and only_fleet in (None, fleet_id) and (is_owner or role is not None)
    if vehicle_id is None:
        return Seen(is_known, False, None, "")
    # Sorted here, because the statement has no ORDER BY.
    state = sorted(repr(row[_WHO:]) for row in rows)
    return Seen(is_known, may_see, fleet_id, sha256("\n".join(state).encode()).hexdigest())


class StateReader:
    """Gathers requests and reads for them. It belongs to one event loop."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._pool = ThreadPoolExecutor(_AT_ONCE, "given-state")
        self._kept: list[_Kept] = []
        self._waiting: list[tuple[Look, asyncio.Future[Seen]]] = []
        self._under_way = 0

    async def read(self, look: Look) -> Seen:
        """What is there now. Raises what the database raises."""
        found: asyncio.Future[Seen] = asyncio.get_running_loop().create_future()
        self._waiting.append((look, found))
        self._go_on()
        return await found

    def close(self) -> None:
        """End the threads and give their connections back."""
        self._pool.shutdown(cancel_futures=True)
        self._give_back()

    def _give_back(self) -> None:
        while True:
            try:
                kept = self._kept.pop()
            except IndexError:  # the other thread may have taken the last one
                return
            kept.stack.close()

    def _go_on(self) -> None:
        if not self._waiting or self._under_way == _AT_ONCE:
            return
        batch, self._waiting = self._waiting[:_MOST], self._waiting[_MOST:]
        self._under_way += 1
        reading = asyncio.get_running_loop().run_in_executor(self._pool, self._read, [look for look, _ in batch])
        reading.add_done_callback(lambda done: self._answer([future for _, future in batch], done))

    def _answer(self, waiting: Sequence[asyncio.Future[Seen]], done: asyncio.Future[list[Seen]]) -> None:
        self._under_way -= 1
        self._go_on()
        error = None if done.cancelled() else done.exception()
        for place, future in enumerate(waiting):
            if future.done():  # its client has left
                continue
            if done.cancelled():
                future.cancel()
            elif error:
                future.set_exception(error)
            else:
                future.set_result(done.result()[place])

    def _read(self, looks: Sequence[Look]) -> list[Seen]:
        try:
            return self._read_once(looks)
        except DBAPIError as error:
            # The kept connection may have ended; a fresh one shows what is wrong.
            if not error.connection_invalidated:
                raise
            self._give_back()
            return self._read_once(looks)

    def _read_once(self, looks: Sequence[Look]) -> list[Seen]:
        by_alias: dict[str, list[int]] = defaultdict(list)
        for place, look in enumerate(looks):
            by_alias[look.alias].append(place)
        found: dict[int, Seen] = {}
        with self._connection() as connection:
            for alias, places in by_alias.items():
                states = read_states(connection, alias, [looks[place] for place in places])
                found.update(zip(places, states, strict=True))
        return [found[place] for place in range(len(looks))]

    @contextmanager
    def _connection(self) -> Iterator[Connection]:
        """A connection that stays open: taking one from the pool costs as much as the statement. An error ends it."""
        try:
            kept = self._kept.pop()
        except IndexError:
            kept = _Kept.open(self._database)
        try:
            yield kept.connection
        except BaseException:
            kept.stack.close()
            raise
        self._kept.append(kept)


class _Kept(NamedTuple):
    connection: Connection
    stack: ExitStack

    @staticmethod
    def open(database: Database) -> _Kept:
        stack = ExitStack()
        connection = stack.enter_context(database.alone())
        if connection.dialect.name == "postgresql":
            # Otherwise it plans at each execution, in ten times the time of the execution: it expects ten rows of an
            # array whose length it does not know, and that seems dearer than the one row that there mostly is.
            connection.exec_driver_sql("SET plan_cache_mode = force_generic_plan")
            # It holds for no other statement: the connection is closed instead of returning to the pool.
            connection.detach()
        return _Kept(connection, stack)
