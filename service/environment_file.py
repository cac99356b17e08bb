"""Writes what docker-compose.yml demands: ``python3 -m service.environment_file``, or ``make env``.

``.env`` gets random secrets and this machine's addresses, ``store-identities.json`` the store's keys out of ``.env``.
What is there stays as it is; an older ``.env`` gets what it lacks. Needs Python's own library alone: the host of a
compose file has no more.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import secrets
from collections.abc import Mapping
from pathlib import Path

ENVIRONMENT = Path(".env")
IDENTITIES = Path("store-identities.json")
BACKUPS = Path("backups")
_SECRETS = (
    *("POSTGRES_PASSWORD", "API_DATABASE_PASSWORD", "WORKER_DATABASE_PASSWORD", "INGEST_DATABASE_PASSWORD"),
    *("VALKEY_PASSWORD", "S3_ACCESS_KEY", "S3_SECRET_KEY", "S3_WORKER_ACCESS_KEY", "S3_WORKER_SECRET_KEY"),
)
_FILES = ("APEXCAL_HOST_USER", "APEXCAL_BACKUPS")
"""Who reads and writes files of the host, and where."""
# The user of the images. Root gives it the files that containers read and write here; anybody else is that user.
_IMAGE_USER = 1000
# The proxy listens on 443 of both names alone; the last label of an IP is a number.
_ADDRESS = re.compile(r"https://(([a-z0-9]([a-z0-9-]*[a-z0-9])?\.)*[a-z]([a-z0-9-]*[a-z0-9])?)/?")
# A line of .env as Compose reads it.
_LINE = re.compile(r"""\s*(?:export\s+)?(\w+)\s*=\s*(["']?)(.*?)\2\s*(?:\s#.*)?""")


def variables(address: str) -> dict[str, str]:
    """The variables of ``.env`` for a service at ``address`` (``https://NAME``), with new secrets."""
    match = _ADDRESS.fullmatch(address.lower())
    if match is None:
        raise ValueError(
            f"{address!r} is no address that docker-compose.yml serves: write https://NAME, as browsers find the "
            "service. NAME is a name, no IP, without port and path"
        )
    is_local = match[1] == "localhost"
    return {
        # Letters and digits: some of them stand in addresses.
        **{name: secrets.token_hex(24) for name in (*_SECRETS, "APEXCAL_METRICS_TOKEN")},
        "APEXCAL_PUBLIC_URL": f"https://{match[1]}",
        "APEXCAL_S3_PUBLIC_ENDPOINT": f"https://blobs.{match[1]}",
        # A browser asks about a page's unknown certificate, but not about that of a store that the page sends to.
        "APEXCAL_UPLOADS": "api" if is_local else "presigned",
        "APEXCAL_HTTP_PORT": "127.0.0.1:80" if is_local else "80",
        "APEXCAL_HTTPS_PORT": "127.0.0.1:443" if is_local else "443",
        "APEXCAL_BACKUPS": f"./{BACKUPS}",
        "APEXCAL_HOST_USER": f"{_IMAGE_USER}:{_IMAGE_USER}" if os.getuid() == 0 else f"{os.getuid()}:{os.getgid()}",
    }


def stated(text: str) -> dict[str, str]:
    """The variables in the text of an ``.env``: quotes and comments are no part of a value."""
    return {match[1]: match[3] for match in map(_LINE.fullmatch, text.splitlines()) if match}


def identities(keys: Mapping[str, str]) -> str:
    """The store's identities: the API may do all, workers what work takes."""

    def identity(name: str, actions: list[str], prefix: str) -> dict[str, object]:
        credentials = {"accessKey": keys[f"{prefix}_ACCESS_KEY"], "secretKey": keys[f"{prefix}_SECRET_KEY"]}
        return {"name": name, "actions": actions, "credentials": [credentials]}

    may_do_all = ["Admin", "Read", "Write", "List", "Tagging"]
    may_work = ["Read:apexcal", "Write:apexcal", "List:apexcal"]
    document = [identity("api", may_do_all, "S3"), identity("workers", may_work, "S3_WORKER")]
    return json.dumps({"identities": document}, indent=2) + "\n"


def _write_private(path: Path, text: str) -> None:
    """Add to a file, which is the owner's alone if it is new."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "w") as file:
        file.write(text)


def main() -> None:
    """Write what is missing and say what."""
    parser = argparse.ArgumentParser(prog="python3 -m service.environment_file", description=__doc__)
    parser.add_argument("--address", default="https://localhost", help="where browsers find the service")
    try:
        all_variables = variables(parser.parse_args().address)
    except ValueError as error:
        parser.error(str(error))
    text = ENVIRONMENT.read_text() if ENVIRONMENT.exists() else ""
    old, names = stated(text), [*all_variables]
    if text:
        # The Compose file has its own words for the rest: a door opens where the operator says so.
        names = [*_SECRETS, *(() if old.get(_FILES[0]) else _FILES)]
    new = {name: all_variables[name] for name in names if not old.get(name)}
    if new:
        begin = "\n" if text and not text.endswith("\n") else ""
        _write_private(ENVIRONMENT, begin + "".join(f"{name}={value}\n" for name, value in new.items()))
    if not text:
        print(f"{ENVIRONMENT} has new secrets and the address {new['APEXCAL_PUBLIC_URL']}")
    else:
        print(f"{ENVIRONMENT} exists and stays as it is{', with ' + ', '.join(new) + ' added' if new else ''}")
    if IDENTITIES.exists():
        print(f"{IDENTITIES} exists and stays as it is")
    else:
        _write_private(IDENTITIES, identities(old | new))
        print(f"{IDENTITIES} has the store's keys out of {ENVIRONMENT}")
    BACKUPS.mkdir(mode=0o700, exist_ok=True)
    if os.getuid() == 0:
        for path in (IDENTITIES, BACKUPS):
            os.chown(path, _IMAGE_USER, _IMAGE_USER)


if __name__ == "__main__":
    main()
