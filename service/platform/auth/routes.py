"""Routes about people: signing in and out, and who is signed in."""

from __future__ import annotations

from urllib.parse import urlsplit

from fastapi import Request, Response
from sqlalchemy import select

from apexcal.documents.people import FleetRole, Me, SignIn
from service.platform.auth.access import COOKIE, Access, Identity, ReadAccess, WriteAccess
from service.platform.auth.origins import check_origin
from service.platform.auth.session_actions import sign_in, sign_out
from service.platform.db.fleets import Fleet
from service.platform.db.people import Membership
from service.platform.db.session import Database
from service.platform.http.router import SIGN_IN, Router
from service.platform.settings import Settings

router = Router(tags=["people"])


@router.post("/sign-in", max_body_size=SIGN_IN)
def post_sign_in(body: SignIn, request: Request, response: Response) -> Me:
    """Consume a one-time sign-in link; the session comes as a cookie."""
    settings: Settings = request.app.state.settings
    database: Database = request.app.state.database
    check_origin(request, settings.public_url, must_name=False)
    with database.writing() as session:
        person, secret = sign_in(session, body.link, settings.session_days)
        roles = session.execute(select(Membership.fleet_id, Membership.role).where(Membership.person_id == person.id))
        identity = Identity(person, {row.fleet_id: row.role for row in roles}, secret)
        me = _me(Access(session, identity))
    response.set_cookie(
        COOKIE,
        secret,
        max_age=settings.session_days * 86_400,
        httponly=True,
        samesite="strict",
        secure=urlsplit(settings.public_url).scheme == "https",
    )
    response.headers["Cache-Control"] = "no-store"
    return me


@router.post("/sign-out", status_code=204)
def post_sign_out(access: WriteAccess, response: Response) -> None:
    """End this browser's session. A token is not a session and stays."""
    sign_out(access.session, access.identity.credential)
    response.delete_cookie(COOKIE, httponly=True, samesite="strict")


@router.get("/me")
def get_me(access: ReadAccess) -> Me:
    """The signed-in person and their fleets."""
    return _me(access)


def _me(access: Access) -> Me:
    fleets = access.session.scalars(access.scope(select(Fleet), Fleet).order_by(Fleet.name))
    person = access.person
    return Me(
        id=person.id,
        name=person.name,
        is_owner=person.is_owner and access.identity.sees_all,
        fleets=[FleetRole(id=fleet.id, name=fleet.name, role=access.role(fleet.id) or "viewer") for fleet in fleets],
    )
