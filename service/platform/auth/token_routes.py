"""Routes about API tokens: they act as the person who made them, within one fleet and at most with a role."""

from __future__ import annotations

from datetime import timedelta
from uuid import UUID

from fastapi.responses import JSONResponse
from sqlalchemy import select

from apexcal.documents.people import MadeToken, NewToken, Token
from apexcal.documents.roles import rank
from service.platform.auth.access import Access, ReadAccess, WriteAccess
from service.platform.auth.credential_actions import TOKEN_PREFIX, new_secret, revoke, secret_hash
from service.platform.auth.member_rules import hold_to_give
from service.platform.db.base import new_id
from service.platform.db.clock import moment
from service.platform.db.fleets import Fleet
from service.platform.db.people import ApiToken
from service.platform.http.pages import Page, Paging, fetch
from service.platform.http.problems import forbidden, not_found
from service.platform.http.router import Router

router = Router(tags=["people"])


@router.post("/fleets/{id}/tokens", status_code=201, response_model=MadeToken)
def post_token(id: UUID, body: NewToken, access: WriteAccess) -> JSONResponse:
    """Make a token for a program. It is shown this once. A person makes it, not another token."""
    access.find(Fleet, id, "engineer")
    hold_to_give(access)
    access.need(id, "engineer")
    own = access.role(id)
    if rank(body.role) > rank(own or ""):
        raise forbidden("role_too_low", f"As {own} you cannot make a token for {body.role}.", "Choose a lesser role.")
    secret = new_secret(TOKEN_PREFIX)
    now = moment(access.session)
    token = ApiToken(
        id=new_id(),
        secret_hash=secret_hash(secret),
        name=body.name,
        person_id=access.person.id,
        fleet_id=id,
        role=body.role,
        made_by=access.identity.token.id if access.identity.token else None,
        expires_at=now + timedelta(days=body.expires_in_days) if body.expires_in_days else None,
        created_at=now,
    )
    access.session.add(token)
    return access.answer(MadeToken(**Token.model_validate(token).model_dump(), token=secret), secret=True)


@router.get("/fleets/{id}/tokens")
def get_tokens(id: UUID, access: ReadAccess, paging: Paging) -> Page[Token]:
    """A fleet's tokens: an admin sees all, an engineer their own."""
    access.find(Fleet, id, "engineer")
    statement = select(ApiToken).where(ApiToken.fleet_id == id)
    if access.role(id) != "admin":
        statement = statement.where(ApiToken.person_id == access.person.id)
    rows, following = fetch(access.session, statement, ApiToken.id, paging)
    return Page(items=[Token.model_validate(row) for row in rows], next=following)


@router.get("/tokens/{id}")
def get_token(id: UUID, access: ReadAccess) -> Token:
    """One token, without its secret."""
    return Token.model_validate(_find(access, id))


@router.delete("/tokens/{id}", status_code=204)
def delete_token(id: UUID, access: WriteAccess) -> None:
    """Revoke a token at once, and end what was made with it."""
    _find(access, id)
    revoke(access.session, ApiToken.id == id)


def _find(access: Access, token_id: UUID) -> ApiToken:
    token = access.find(ApiToken, token_id, "engineer")
    if token.person_id != access.person.id and access.role(token.fleet_id or token_id) != "admin":
        raise not_found()
    return token
