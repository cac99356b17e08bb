"""People with roles, and clients that act for them."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from uuid import UUID

with warnings.catch_warnings():
    # starlette wants httpx2, which the product does not need: httpx is its client library.
    warnings.simplefilter("ignore")
    from starlette.testclient import TestClient

from fastapi import FastAPI

from service.platform.auth.credential_actions import TOKEN_PREFIX, new_secret, secret_hash
from service.platform.db.base import new_id
from service.platform.db.fleets import Fleet
from service.platform.db.people import ApiToken, Membership, Person
from service.platform.db.session import Database


@dataclass
class Actor:
    """A person, their token, and a client that sends it."""

    person_id: UUID
    token: str
    client: TestClient

    @property
    def headers(self) -> dict[str, str]:
        """What signs this person in."""
        return {"Authorization": f"Bearer {self.token}"}

    def request(self, method: str, path: str, **options: Any) -> Any:
        """Send a request to /v1 as this person and return the response."""
        headers = {**self.headers, **options.pop("headers", {})}
        return self.client.request(method, f"/v1{path}", headers=headers, **options)

    def get(self, path: str, **options: Any) -> Any:
        """GET."""
        return self.request("GET", path, **options)

    def post(self, path: str, json: Any = None, **options: Any) -> Any:
        """POST."""
        return self.request("POST", path, **({"json": json} if json is not None else {}), **options)

    def put(self, path: str, **options: Any) -> Any:
        """PUT."""
        return self.request("PUT", path, **options)

    def patch(self, path: str, json: Any = None, **options: Any) -> Any:
        """PATCH."""
        return self.request("PATCH", path, json=json, **options)

    def delete(self, path: str, **options: Any) -> Any:
        """DELETE."""
        return self.request("DELETE", path, **options)


@dataclass
class Api:
    """The served application with a way to make people of it. Rows that people need are made in the database."""

    app: FastAPI
    client: TestClient
    _fleets: int = field(default=0)

    @property
    def database(self) -> Database:
        """The application's database."""
        return self.app.state.database

    def fleet(self, name: str | None = None) -> UUID:
        """Make a fleet."""
        self._fleets += 1
        with self.database.writing() as session:
            fleet = Fleet(id=new_id(), name=name or f"fleet {self._fleets}")
            session.add(fleet)
        return fleet.id

    def person(self, name: str = "somebody", *, owner: bool = False, **roles: Any) -> Actor:
        """Make a person; ``fleet=<id>, role=<role>`` makes them a member."""
        memberships = {roles["fleet"]: roles["role"]} if roles else {}
        return Actor(*add_person(self.database, name, owner=owner, roles=memberships), self.client)

    def owner(self) -> Actor:
        """Make an owner."""
        return self.person("owner", owner=True)

    def member(self, fleet_id: UUID, role: str, name: str | None = None) -> Actor:
        """Make a member of a fleet."""
        return self.person(name or role, fleet=fleet_id, role=role)


def add_person(
    database: Database, name: str, *, owner: bool = False, roles: Mapping[UUID, str] | None = None
) -> tuple[UUID, str]:
    """Make a person with a role in each of these fleets. Returns their id and a token."""
    secret, person = new_secret(TOKEN_PREFIX), Person(id=new_id(), name=name, is_owner=owner)
    with database.writing() as session:
        session.add(person)
        session.flush()
        session.add(ApiToken(secret_hash=secret_hash(secret), name="test", person_id=person.id))
        session.add_all(Membership(person_id=person.id, fleet_id=id, role=role) for id, role in (roles or {}).items())
    return person.id, secret
