"""The answer that every vehicle asks for at every start: checked by one read of the database, made once, kept."""

from __future__ import annotations

import json
from hashlib import sha256
from uuid import UUID

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse, Response
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.auth.access import Identity, identified
from service.auth.secrets import TOKEN_PREFIX
from service.calibrations.given_state import Look, Seen, read_states
from service.calibrations.given_views import cameras_of, given_documents
from service.calibrations.kept_answers import KeptAnswers
from service.calibrations.state_reader import StateReader
from service.db.fleets import Vehicle
from service.db.session import Database
from service.exports.answers import exported
from service.exports.given_queries import Asked
from service.exports.queries import of_given
from service.http.etags import Conditions, content_etag, names
from service.http.problems import Problem, not_found

# Part of every ETag: a version whose answers differ takes the next number.
_FORM = "1"
# Publications come minutes apart; a state that changes at every read is a fault.
_TRIES = 3
_USUAL = Asked((), CURRENT, None, {})


class Retrieval:
    """One process's answers, kept by ETag. Each request reads the state that gives the ETag from the database."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._states = StateReader(database)
        self._kept = KeptAnswers()

    def close(self) -> None:
        """End the threads that read."""
        self._states.close()

    async def answer_at_once(self, request: Request, vehicle_id: UUID) -> Response | None:
        """The answer to a car's usual question, if the car has it or it is kept. None for all else, refusals too."""
        secret = _token(request)
        if secret is None:
            return None
        try:
            seen = await self._states.read(Look(secret, vehicle_id, CURRENT))
        except DBAPIError:
            return None
        return self._at_hand(request, _etag(vehicle_id, _USUAL, None, seen.digest), None) if seen.may_see else None

    async def answer(self, request: Request, vehicle_id: UUID, asked: Asked, wanted: str | None) -> Response:
        """The answer to a request. Raises :class:`Problem`."""
        seen = await self._states.read(Look(_token(request) or "", vehicle_id, asked.alias))
        if not seen.may_see:
            _check(None if seen.is_known else await identified(request), seen)
        if asked.as_of is not None:
            return await run_in_threadpool(self._make_then, request, vehicle_id, asked, wanted)
        at_hand = self._at_hand(request, _etag(vehicle_id, asked, wanted, seen.digest), wanted)
        if at_hand is not None:
            return at_hand
        made, etag = await run_in_threadpool(self._make, vehicle_id, asked, wanted, seen.digest)
        if wanted is None:
            self._kept.put(etag, bytes(made.body))
        return _unless_any(request, made, etag)

    def answer_now(
        self, request: Request, identity: Identity, vehicle_id: UUID, asked: Asked, wanted: str | None
    ) -> Response:
        """The same in a thread, for a vehicle that was looked for and found."""
        seen = self._look(vehicle_id, asked.alias)
        _check(identity, seen)
        if asked.as_of is not None:
            return self._make_then(request, vehicle_id, asked, wanted)
        etag = _etag(vehicle_id, asked, wanted, seen.digest)
        if _has(request, etag):
            return Response(status_code=304, headers=_headers(etag))
        return _unless_any(request, *self._make(vehicle_id, asked, wanted, seen.digest))

    def _at_hand(self, request: Request, etag: str, wanted: str | None) -> Response | None:
        """The answer with this ETag, if the client has it or it is kept."""
        if _has(request, etag):
            return Response(status_code=304, headers=_headers(etag))
        kept = None if wanted else self._kept.get(etag)
        if kept is None:
            return None
        return _unless_any(request, Response(kept, media_type="application/json", headers=_headers(etag)), etag)

    def _look(self, vehicle_id: UUID, alias: str) -> Seen:
        with self._database.alone() as connection:
            return read_states(connection, alias, [Look("", vehicle_id, alias)])[0]

    def _make_then(self, request: Request, vehicle_id: UUID, asked: Asked, wanted: str | None) -> Response:
        """What was given at a moment. Rows of before decide it too, and they may be deleted: it is never kept."""
        with self._database.reading() as session:
            vehicle = session.get(Vehicle, vehicle_id)
            if vehicle is None:
                raise not_found()
            made = _made(session, vehicle, asked, wanted, "")
        etag = _etag(vehicle_id, asked, wanted, sha256(bytes(made.body)).hexdigest())
        made.headers["ETag"] = etag
        return _unless_any(request, made, etag)

    def _make(self, vehicle_id: UUID, asked: Asked, wanted: str | None, digest: str) -> tuple[Response, str]:
        """The answer with the ETag of the state that it was made from, which was the same before and after."""
        for _ in range(_TRIES):
            with self._database.reading() as session:
                vehicle = session.get(Vehicle, vehicle_id)
                if vehicle is None:
                    raise not_found()
                etag = _etag(vehicle_id, asked, wanted, digest)
                made = _made(session, vehicle, asked, wanted, etag)
            after = self._look(vehicle_id, asked.alias).digest
            if after == digest:
                return made, etag
            digest = after
        raise Problem(409, "conflict", "The vehicle's calibration is changing at this moment.", "Ask again.")


def _token(request: Request) -> str | None:
    """The API token that the request carries."""
    kind, _, bearer = request.headers.get("authorization", "").partition(" ")
    return bearer if kind.lower() == "bearer" and bearer.startswith(TOKEN_PREFIX) else None


def _made(session: Session, vehicle: Vehicle, asked: Asked, wanted: str | None, etag: str) -> Response:
    if wanted is not None:
        # Without the request's conditions: they are of this answer's ETag, not of the file's.
        unconditional = Request({"type": "http", "method": "GET", "headers": []})
        made = exported(wanted, of_given(session, vehicle, asked), Conditions(unconditional, Response()))
        made.headers["ETag"] = etag
        return made
    found = given_documents(session, vehicle, asked)
    without = [] if asked.cameras else sorted(cameras_of(session, vehicle.id) - set(found))
    document = {
        "vehicle_id": vehicle.id,
        "vehicle": vehicle.name,
        "alias": asked.alias,
        "as_of": asked.as_of,
        "cameras": found,
        "without": without,
    }
    return JSONResponse(jsonable_encoder(document), headers=_headers(etag))


def _has(request: Request, etag: str) -> bool:
    """Whether the client names this answer. `*` names any; whether there is one shows when it is made."""
    header = request.headers.get("if-none-match", "")
    return header.strip() != "*" and names(header, etag)


def _unless_any(request: Request, made: Response, etag: str) -> Response:
    """An answer that was made, or that the client has it."""
    if names(request.headers.get("if-none-match"), etag):
        return Response(status_code=304, headers=_headers(etag))
    return made


def _check(identity: Identity | None, seen: Seen) -> None:
    """Raises :class:`Problem` 404 for what is not there, and for a vehicle of a fleet that the person is not in."""
    if identity is None or seen.fleet_id is None or identity.role(seen.fleet_id) is None:
        raise not_found()


def _etag(vehicle_id: UUID, asked: Asked, wanted: str | None, digest: str) -> str:
    """The hash of the state and the question, so another question has another ETag."""
    as_of = asked.as_of and asked.as_of.isoformat()
    question = [_FORM, str(vehicle_id), asked.alias, *asked.cameras, as_of, sorted(asked.mounted.items()), wanted]
    return content_etag(sha256(json.dumps([question, digest]).encode()).hexdigest())


def _headers(etag: str) -> dict[str, str]:
    return {"ETag": etag, "Vary": "Accept", "Cache-Control": "private, no-cache"}
