"""Routes about a fleet's people: members and invitations."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from fastapi import Request
from fastapi.responses import JSONResponse
from sqlalchemy import select

from apexcal.documents.people import ChangedMember, Invitation, Member, NewInvitation, NewRole
from apexcal.documents.roles import rank
from service.platform.auth.access import ReadAccess, WriteAccess
from service.platform.auth.credential_actions import end_credentials
from service.platform.auth.member_rules import (
    check_leaves_an_admin,
    check_may_give,
    check_may_sign_in_as,
    find_member,
    hold_to_give,
)
from service.platform.auth.session_actions import make_link
from service.platform.broker.hints import hint
from service.platform.db.base import new_id
from service.platform.db.fleets import Fleet
from service.platform.db.people import Membership, Person
from service.platform.http.pages import Page, Paging, fetch
from service.platform.http.router import Router
from service.platform.settings import Settings

router = Router(tags=["people"])


@router.get("/fleets/{id}/members")
def get_members(id: UUID, access: ReadAccess, paging: Paging) -> Page[Member]:
    """Who is in a fleet."""
    access.find(Fleet, id, "engineer")
    statement: Any = (
        select(Membership, Person).join(Person, Person.id == Membership.person_id).where(Membership.fleet_id == id)
    )
    rows, following = fetch(access.session, statement, Membership.person_id, paging)
    return Page(items=[_member(membership, person) for membership, person in rows], next=following)


@router.patch("/fleets/{id}/members/{person_id}")
def patch_member(id: UUID, person_id: UUID, body: NewRole, access: WriteAccess) -> ChangedMember:
    """Give a member another role. A higher one ends their sessions, links and tokens; an admin makes a new link."""
    access.find(Fleet, id, "admin")
    hold_to_give(access, person_id)
    access.find(Fleet, id, "admin", lock=True)
    membership, person = find_member(access, id, person_id)
    if body.role != "admin":
        check_leaves_an_admin(access, membership, person)
    # An owner has every right in every fleet already, whatever their role.
    is_raised = rank(body.role) > rank(membership.role) and not person.is_owner
    membership.role = body.role
    # Somebody else may hold a link, session or token from before, and would get the higher role too.
    ended = end_credentials(access.session, person_id, id) if is_raised else None
    hint(access.session, id, "member", person_id)
    changed = {**_member(membership, person).model_dump(), "ended": ended and ended._asdict()}
    return ChangedMember.model_validate(changed)


@router.delete("/fleets/{id}/members/{person_id}", status_code=204)
def delete_member(id: UUID, person_id: UUID, access: WriteAccess) -> None:
    """Take a person out of a fleet. What they marked stays."""
    access.find(Fleet, id, "admin", lock=True)
    membership, person = find_member(access, id, person_id)
    check_leaves_an_admin(access, membership, person)
    access.session.delete(membership)
    hint(access.session, id, "member", person_id)


@router.post("/fleets/{id}/invitations", status_code=201, response_model=Invitation)
def post_invitation(id: UUID, body: NewInvitation, request: Request, access: WriteAccess) -> JSONResponse:
    """Make a one-time sign-in link: for a new person, or with ``person_id`` for a member who lost their session."""
    settings: Settings = request.app.state.settings
    access.find(Fleet, id, "engineer")
    hold_to_give(access, *filter(None, (body.person_id,)))
    if body.person_id is None:
        check_may_give(access, id, body.role)
        person = Person(id=new_id(), name=body.name)
        access.session.add(person)
        access.session.flush()
        membership = Membership(person_id=person.id, fleet_id=id, role=body.role)
        access.session.add(membership)
    else:
        membership, person = find_member(access, id, body.person_id)
        check_may_sign_in_as(access, person)
    token = access.identity.token
    link, expires_at = make_link(
        access.session, person.id, settings.public_url, settings.invitation_hours, token and token.id
    )
    hint(access.session, id, "member", person.id)
    member: dict[str, Any] = _member(membership, person).model_dump()
    return access.answer(Invitation(**member, link=link, expires_at=expires_at), secret=True)


def _member(membership: Membership, person: Person) -> Member:
    return Member.model_validate({"person_id": person.id, "name": person.name, "role": membership.role})
