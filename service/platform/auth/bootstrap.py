"""``python -m service.platform.auth.bootstrap`` makes the owner if there is none, and prints a sign-in link."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from sqlalchemy import select, update
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from apexcal.documents.base import Name, first_fault
from service.platform.auth.credential_actions import TOKEN_PREFIX, hand_over, hold, new_secret, secret_hash
from service.platform.auth.session_actions import make_link
from service.platform.db.base import new_id
from service.platform.db.clock import now
from service.platform.db.people import ApiToken, Person
from service.platform.db.session import Database
from service.platform.settings import settings_or_exit

_LOCAL_TOKEN = "this machine"


def owner(session: Session, name: str = "Owner") -> Person:
    """The first owner, made where there is none."""
    person = session.scalar(select(Person).where(Person.is_owner).order_by(Person.id).limit(1))
    if person is None:
        person = Person(name=name, is_owner=True)
        session.add(person)
        session.flush()
    return person


def renew_owner_token(session: Session, person: Person) -> str:
    """A fresh token of the owner for programs on this machine; earlier ones end in a minute.

    They do not end at once because a command that started a moment ago may still hold one.
    """
    hold(session, person.id)
    earlier = session.scalars(
        update(ApiToken)
        .where(ApiToken.person_id == person.id, ApiToken.name == _LOCAL_TOKEN, ApiToken.expires_at.is_(None))
        .values(expires_at=now(60.0))
        .returning(ApiToken.id)
    ).all()
    secret = new_secret(TOKEN_PREFIX)
    token = ApiToken(id=new_id(), secret_hash=secret_hash(secret), name=_LOCAL_TOKEN, person_id=person.id)
    session.add(token)
    # People who were invited at the command line stay signed in; their sessions end with the token that is valid now.
    hand_over(session, [*earlier], token.id)
    return secret


def write_private(path: Path, text: str) -> None:
    """Write a file that only its owner can read, replacing it whole."""
    staged = path.with_name(path.name + ".new")
    staged.unlink(missing_ok=True)
    descriptor = os.open(staged, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w") as file:
        file.write(text)
    staged.replace(path)


def _name(text: str) -> str:
    try:
        return TypeAdapter(Name).validate_python(text)
    except ValidationError as error:
        raise argparse.ArgumentTypeError(first_fault(error)[1]) from None


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the owner's link; with --token-file, leave an API token there too."""
    parser = argparse.ArgumentParser(prog="python -m service.platform.auth.bootstrap", description=__doc__)
    parser.add_argument("--name", default="Owner", type=_name, help="the owner's name, where there is no owner yet")
    parser.add_argument("--token-file", type=Path, help="write an API token of the owner to this file (mode 0600)")
    parser.add_argument("--no-link", action="store_true", help="print no sign-in link")
    chosen = parser.parse_args(arguments)
    settings = settings_or_exit()
    database = Database(settings.database)
    try:
        with database.writing() as session:
            person = owner(session, chosen.name)
            token = renew_owner_token(session, person) if chosen.token_file else ""
            link = ""
            if not chosen.no_link:
                link, _ = make_link(session, person.id, settings.public_url, settings.invitation_hours)
        if chosen.token_file:
            write_private(chosen.token_file, token + "\n")
        if link:
            print(link)
    except SQLAlchemyError as error:
        message = str(getattr(error, "orig", None) or error).strip().partition("\n")[0]
        sys.exit(f"The database: {message}. Did `python -m service.platform.db.migrate` run?")
    except OSError as error:
        sys.exit(f"{error.filename}: {error.strerror}")
    finally:
        database.close()


if __name__ == "__main__":
    main()
