"""The answer that every vehicle asks for at every start. One look at the database says whether the vehicle has it."""

from __future__ import annotations

import json
from hashlib import sha256
from uuid import UUID

from fastapi import Request
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse, Response
from sqlalchemy.orm import Session

from apexcal.documents.exports import VEHICLE_HEADER
from service.exports.answers import exported
from service.platform.auth.access import Identity, identified
from service.platform.auth.credential_actions import TOKEN_PREFIX, secret_hash
from service.platform.db.fleets import Vehicle
from service.platform.db.session import Database
from service.platform.http.etags import Conditions, content_etag, names, repr_digest
from service.platform.http.lookups import Lookups
from service.platform.http.problems import not_found
from service.platform.http.threads import Threads
from service.publications.calibration_views import vehicle_document
from service.publications.camera_queries import published_exports
from service.publications.selection import Selection
from service.publications.state_queries import digest_of, state_for_token, state_of_vehicle

# Part of every ETag: a version whose answers differ takes the next number.
_FORM = "2"


class Retrieval:
    """Answers vehicles. Each answer, and its ETag, is of one state of the database, read after the request came."""

    def __init__(self, database: Database, threads: Threads, lookups: Lookups) -> None:
        dialect = database.engine.dialect.name
        self._database = database
        self._threads = threads
        self._lookups = lookups
        self._for_token, self._of_vehicle = state_for_token(dialect), state_of_vehicle(dialect)

    async def answer(
        self, request: Request, vehicle_id: UUID, selection: Selection, format_name: str | None
    ) -> Response:
        """The answer to a request. Raises :class:`Problem`."""
        digest = await self._digest_for_token(request, vehicle_id, selection.alias)
        # The usual way tells who may not see the vehicle, or sends no token.
        identity = await identified(request) if digest is None else None
        if digest is not None and selection.as_of is None:
            etag = _etag(vehicle_id, selection, format_name, digest)
            if _has(request, etag):
                return Response(status_code=304, headers=_headers(etag))
        return await self._threads.reading.run(self._read, request, identity, vehicle_id, selection, format_name)

    def answer_within(
        self, session: Session, request: Request, vehicle: Vehicle, selection: Selection, format_name: str | None
    ) -> Response:
        """The answer about a vehicle that the person may see. ``session`` reads all at one moment."""
        bindings = {"vehicle": vehicle.id, "alias": selection.alias}
        digest = digest_of(session.scalars(self._of_vehicle, bindings)) or ""
        etag = _etag(vehicle.id, selection, format_name, digest)
        if selection.as_of is None and _has(request, etag):
            return Response(status_code=304, headers=_headers(etag))
        response = _made(session, vehicle, selection, format_name)
        if selection.as_of is not None:
            # Earlier publications also matter, and their results may be gone.
            etag = _etag(vehicle.id, selection, format_name, sha256(bytes(response.body)).hexdigest())
        if names(request.headers.get("if-none-match"), etag):
            return Response(status_code=304, headers=_headers(etag))
        response.headers.update(_headers(etag) | {VEHICLE_HEADER: str(vehicle.id)})
        return response

    async def _digest_for_token(self, request: Request, vehicle_id: UUID, alias: str) -> str | None:
        kind, _, token = request.headers.get("authorization", "").partition(" ")
        if kind.lower() != "bearer" or not token.startswith(TOKEN_PREFIX):
            return None
        hashed = secret_hash(token)
        bindings = {"secret": hashed, "vehicle": vehicle_id, "alias": alias}
        return digest_of(row[0] for row in await self._lookups.rows(self._for_token, bindings, hashed))

    def _read(
        self,
        request: Request,
        identity: Identity | None,
        vehicle_id: UUID,
        selection: Selection,
        format_name: str | None,
    ) -> Response:
        """``identity``: who asks, where nothing has shown yet that they may see the vehicle."""
        with self._database.snapshot() as session:
            vehicle = session.get(Vehicle, vehicle_id)
            if vehicle is None or (identity is not None and identity.role(vehicle.fleet_id) is None):
                raise not_found()
            return self.answer_within(session, request, vehicle, selection, format_name)


def _made(session: Session, vehicle: Vehicle, selection: Selection, format_name: str | None) -> Response:
    if format_name is not None:
        # Without the request's conditions: they are of this answer's ETag, not of the file's.
        unconditional = Request({"type": "http", "method": "GET", "headers": []})
        return exported(
            format_name, published_exports(session, vehicle, selection), Conditions(unconditional, Response())
        )
    response = JSONResponse(jsonable_encoder(vehicle_document(session, vehicle, selection)))
    response.headers.update(repr_digest(bytes(response.body)))
    return response


def _has(request: Request, etag: str) -> bool:
    """Whether the client names this answer. `*` names any; whether there is one shows when it is made."""
    header = request.headers.get("if-none-match", "")
    return header.strip() != "*" and names(header, etag)


def _etag(vehicle_id: UUID, selection: Selection, format_name: str | None, digest: str) -> str:
    """The hash of the state and the question, so another question has another ETag."""
    as_of = selection.as_of and selection.as_of.isoformat()
    question = [_FORM, str(vehicle_id), selection.alias, *selection.cameras, as_of]
    question += [sorted(selection.mounted.items()), format_name]
    return content_etag(sha256(json.dumps([question, digest]).encode()).hexdigest())


def _headers(etag: str) -> dict[str, str]:
    return {"ETag": etag, "Vary": "Accept", "Cache-Control": "private, no-cache"}
