"""Who asks, and what they may: the one helper through which every route reaches rows.

``ReadAccess`` and ``WriteAccess`` carry a session that the route's own thread opens, and commits before the answer
is sent (:mod:`service.platform.http.router`). Rows of a fleet that the person is not in do not exist for them: 404,
never 403.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Annotated, Any, NamedTuple, TypeVar
from uuid import UUID

from fastapi import Depends, Request
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from sqlalchemy import ColumnElement, Select, bindparam, select
from sqlalchemy.orm import Session

from apexcal.documents.roles import Role, least, rank
from service.platform.auth.credential_actions import TOKEN_PREFIX, secret_hash
from service.platform.auth.origins import check_origin
from service.platform.db.clock import now
from service.platform.db.fleets import Fleet
from service.platform.db.people import ApiToken, BrowserSession, IdempotencyKey, Membership, Person
from service.platform.http.idempotency import RequestKey, kept_answer, of_caller, repeat, request_key
from service.platform.http.lookups import Lookups
from service.platform.http.problems import Problem, forbidden, not_found
from service.platform.http.router import Transaction
from service.platform.observability.logs import say_who

COOKIE = "apexcal_session"
_SCOPE = "apexcal.identity"

# Seconds after which credentials are checked again, because a body may come slowly after them.
FRESH_S = 1.0

# For more fleets the rows are sorted together, because the statement would get too long.
_FLEETS_ONE_BY_ONE = 50

ModelT = TypeVar("ModelT")


class TokenFacts(NamedTuple):
    """An API token as it limits its holder, and whether it ends."""

    id: UUID
    fleet_id: UUID | None
    role: str | None
    ends: bool


@dataclass(frozen=True)
class Identity:
    """A person who proved who they are, with ``credential``, and the fleets and role that it is limited to.

    ``known_at`` is when, on the clock that only goes forward.
    """

    person: Person
    roles: dict[UUID, Role]
    credential: str
    only_fleet: UUID | None = None
    only_role: str | None = None
    token: TokenFacts | None = None
    known_at: float = field(default_factory=time.monotonic, compare=False)

    @property
    def sees_all(self) -> bool:
        """Whether every fleet is theirs."""
        return self.person.is_owner and self.only_fleet is None

    def role(self, fleet_id: UUID) -> Role | None:
        """The role in a fleet, or None where the person is not in it."""
        if self.only_fleet is not None and fleet_id != self.only_fleet:
            return None
        role: Role | None = "admin" if self.person.is_owner else self.roles.get(fleet_id)
        return least(role, self.only_role) if role else None


class Access:
    """A session together with what its person may do with it."""

    def __init__(self, session: Session, identity: Identity, key: RequestKey | None = None) -> None:
        self._session = session
        self.identity = identity
        self.person = identity.person
        self._key = key
        self._is_known_new = False
        self._took: tuple[UUID, Role] | None = None

    @property
    def session(self) -> Session:
        """The session. Its first use looks whether this request was answered before, and raises that answer.

        Not earlier: who waits there for a twin of the request does so where the route has a thread already.
        It raises :class:`Problem` 401 ``not_signed_in`` too, where the credential ended while the body came.
        """
        if not self._is_known_new:
            self._is_known_new = True
            if time.monotonic() - self.identity.known_at > FRESH_S:
                self.confirm()
            self._replay()
        return self._session

    @property
    def opened_session(self) -> Session:
        """The session, which this does not use yet: a route may have needed no writer."""
        return self._session

    def role(self, fleet_id: UUID) -> Role | None:
        """The person's role in a fleet, or None."""
        return self.identity.role(fleet_id)

    def sees_answers(self, fleet_id: UUID) -> bool:
        """Whether the person may see single people's answers, and what repeats them: notes, pairs made of marks."""
        return rank(self.role(fleet_id) or "") >= rank("reviewer")

    def need(self, fleet_id: UUID, role: Role) -> None:
        """Raises :class:`Problem` 404 outside the person's fleets, 403 where their role there is too low."""
        actual = self.role(fleet_id)
        if actual is None:
            raise not_found()
        if rank(actual) < rank(role):
            raise forbidden(
                "role_too_low",
                f"This takes the role {role} in the fleet, and you are {actual}.",
                "Ask an admin of the fleet to change your role.",
            )
        if self._took is None or rank(role) > rank(self._took[1]):
            self._took = (fleet_id, role)

    def confirm(self) -> None:
        """Look again who asks, now in this transaction: their credential may have ended, and their role changed.

        Raises :class:`Problem` 401 ``not_signed_in``.
        """
        is_token = self.identity.token is not None
        self.identity = _look_up(self._session, self.identity.credential, is_token=is_token)

    def find(self, model: type[ModelT], key: Any, role: Role = "viewer", *, lock: bool = False) -> ModelT:
        """The row of ``model`` with this key, where the person has ``role`` in its fleet.

        ``lock`` holds the row until the transaction ends (PostgreSQL; SQLite has one writer at a time). Its key stays
        free: whoever inserts rows that belong to it waits for nobody, and nobody for them.
        """
        row = self.session.get(model, key, with_for_update={"key_share": True} if lock else None)
        fleet_id = None if row is None else row.id if isinstance(row, Fleet) else getattr(row, "fleet_id", None)
        if row is None or fleet_id is None:
            raise not_found()
        self.need(fleet_id, role)
        return row

    def scope(self, statement: Select[Any], model: Any, role: Role = "viewer") -> Select[Any]:
        """Limit a query to the rows of ``model`` in fleets where the person has ``role``."""
        column = model.id if model is Fleet else model.fleet_id
        if self.identity.sees_all:
            return statement
        return statement.where(column.in_(self._fleets(role)))

    def scopes(self, model: Any, fleet_id: UUID | None = None) -> list[ColumnElement[bool]]:
        """The fleets that the person may see, or of these the one that is asked for, as conditions for a list.

        For :func:`service.platform.http.pages.fetch`; empty where all rows may be seen.
        """
        if self.identity.sees_all:
            return [] if fleet_id is None else [model.fleet_id == fleet_id]
        fleets = [id for id in self._fleets("viewer") if fleet_id in (None, id)]
        if not 0 < len(fleets) <= _FLEETS_ONE_BY_ONE:
            return [model.fleet_id.in_(fleets)]
        return [model.fleet_id == id for id in fleets]

    def _fleets(self, role: Role) -> list[UUID]:
        fleets = {*self.identity.roles, *filter(None, (self.identity.only_fleet,))}
        return sorted(id for id in fleets if rank(self.role(id) or "") >= rank(role))

    def answer(self, body: BaseModel | dict[str, Any], status: int = 201, *, secret: bool = False) -> JSONResponse:
        """The answer of a POST that made something, kept with it where the request has an Idempotency-Key.

        ``secret`` says that the answer holds one: then only is kept that it was given.
        """
        document: dict[str, Any] = jsonable_encoder(body)
        if self._key:
            self._remember(self._key, status, document, secret=secret)
        headers = {"Cache-Control": "no-store"} if secret else None
        return JSONResponse(document, status_code=status, headers=headers)

    def _remember(self, key: RequestKey, status: int, document: dict[str, Any], *, secret: bool) -> None:
        fleet_id, role = self._took or (None, None)
        self.session.add(
            IdempotencyKey(
                person_id=self.person.id,
                key=key.key,
                request_hash=key.request_hash,
                fleet_id=fleet_id,
                role=role,
                status=status,
                body=None if secret else document,
            )
        )

    def _replay(self) -> None:
        """Raises what repeats the answer that this request got before; nothing where it is new.

        Raises :class:`Problem` where its key belongs to another request, and where who asks may no longer make it.
        """
        answer = kept_answer(self.session, self.person.id, self._key) if self._key else None
        if answer is None:
            return
        if answer.fleet_id is not None:
            self.need(answer.fleet_id, answer.role or "admin")  # pyright: ignore[reportArgumentType] - only roles
        raise repeat(answer)


async def identified(request: Request) -> Identity:
    """Return the identity of the caller, looked up once a request. It waits for no lock.

    Raises :class:`Problem` 401 ``not_signed_in``.
    """
    identity: Identity | None = request.scope.get(_SCOPE)
    if identity is not None:
        return identity
    kind, _, bearer = request.headers.get("authorization", "").partition(" ")
    is_token = kind.lower() == "bearer" and bearer.startswith(TOKEN_PREFIX)
    secret = bearer if is_token else request.cookies.get(COOKIE)
    if not secret:
        raise _not_signed_in("The request carries neither a session nor an API token.")
    if not is_token:
        check_origin(request, request.app.state.settings.public_url)
    lookups: Lookups = request.app.state.lookups
    rows = await lookups.rows(_valid(is_token=is_token), _named(secret), secret_hash(secret))
    identity = request.scope[_SCOPE] = _identity_of(rows, secret, is_token=is_token)
    token = {"token": str(identity.token.id)} if identity.token else {}
    say_who(person=str(identity.person.id), **token)
    return identity


def renewed(session: Session, identity: Identity) -> Identity | None:
    """Return the identity of the same credential now; None if it has ended."""
    try:
        return _look_up(session, identity.credential, is_token=identity.token is not None)
    except Problem:
        return None


def _look_up(session: Session, secret: str, *, is_token: bool) -> Identity:
    return _identity_of(session.execute(_valid(is_token=is_token), _named(secret)).all(), secret, is_token=is_token)


def _named(secret: str) -> dict[str, Any]:
    return {"hash": secret_hash(secret)}


def _identity_of(rows: Sequence[Sequence[Any]], secret: str, *, is_token: bool) -> Identity:
    if not rows:
        ended = "The API token is unknown, revoked or has ended." if is_token else "The browser's session has ended."
        raise _not_signed_in(ended)
    (person_id, name, is_owner, *_), token = rows[0], TokenFacts(*rows[0][5:]) if is_token else None
    person = Person(id=person_id, name=name, is_owner=is_owner)
    roles: dict[UUID, Role] = {row[3]: row[4] for row in rows if row[3] is not None}
    return Identity(person, roles, secret, token and token.fleet_id, token and token.role, token)


@cache
def _valid(*, is_token: bool) -> Select[*tuple[Any, ...]]:
    """Id, name and ``is_owner`` of who has a credential that has not ended, fleet and role, and the token's facts.

    One row for each fleet, or one without.
    """
    kind = ApiToken if is_token else BrowserSession
    lasts = kind.expires_at > now()
    if is_token:
        lasts = ApiToken.revoked_at.is_(None) & (ApiToken.expires_at.is_(None) | lasts)
    facts = (ApiToken.id, ApiToken.fleet_id, ApiToken.role, ApiToken.expires_at.is_not(None)) if is_token else ()
    return (
        select(Person.id, Person.name, Person.is_owner, Membership.fleet_id, Membership.role, *facts)
        .join(kind, kind.person_id == Person.id)
        .outerjoin(Membership, Membership.person_id == Person.id)
        .where(kind.secret_hash == bindparam("hash"), lasts)
    )


def _not_signed_in(detail: str) -> Problem:
    return Problem(
        401,
        "not_signed_in",
        detail,
        "Open a sign-in link in the browser, or send Authorization: Bearer apx_... from a program.",
        headers={"WWW-Authenticate": "Bearer"},
    )


CurrentIdentity = Annotated[Identity, Depends(identified)]


@contextmanager
def _accessing(
    open_session: Callable[[], AbstractContextManager[Session]], identity: Identity, key: RequestKey | None = None
) -> Iterator[Access]:
    with open_session() as session:
        yield Access(session, identity, key)


def brief_access(request: Request, identity: Identity) -> AbstractContextManager[Access]:
    """An :class:`Access` that only reads, and ends before any byte of a long answer is read."""
    return _accessing(request.app.state.database.reading, identity)


# Each dependency of a dependency is solved by itself, at a cost, so these call what they need.
async def read_access(request: Request) -> Transaction:
    """Open an :class:`Access` that only reads."""
    identity, database = await identified(request), request.app.state.database
    return Transaction(partial(_accessing, database.reading, identity), writes=False)


async def write_access(request: Request) -> Transaction:
    """Open an :class:`Access` that writes, under the request's Idempotency-Key."""
    identity, database, key = await identified(request), request.app.state.database, await request_key(request)
    if key:
        key = of_caller(key, secret_hash(identity.credential), identity.only_fleet, identity.only_role)
    return Transaction(partial(_accessing, database.writing, identity, key), writes=True)


ReadAccess = Annotated[Access, Depends(read_access)]
WriteAccess = Annotated[Access, Depends(write_access)]
