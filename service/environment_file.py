"""Writes what docker-compose.yml demands: ``python3 -m service.environment_file``, or ``make env``.

``.env`` gets random secrets and this machine's addresses, ``store-identities.json`` the store's keys out of ``.env``.
A file that exists stays as it is. Needs Python's own library alone: the host of a compose file has no more.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import urlsplit

ENVIRONMENT = Path(".env")
IDENTITIES = Path("store-identities.json")
BACKUPS = Path("backups")
_SECRETS = (
    *("POSTGRES_PASSWORD", "API_DATABASE_PASSWORD", "WORKER_DATABASE_PASSWORD", "VALKEY_PASSWORD"),
    *("S3_ACCESS_KEY", "S3_SECRET_KEY", "S3_WORKER_ACCESS_KEY", "S3_WORKER_SECRET_KEY", "APEXCAL_METRICS_TOKEN"),
)
# The user of the images. Root gives it the files that containers read and write here; anybody else is that user.
_IMAGE_USER = 1000


def variables(address: str) -> dict[str, str]:
    """The variables of ``.env`` for a service at ``address`` (``https://NAME``), with new secrets."""
    host = urlsplit(address).hostname
    if not host or not address.startswith("https://"):
        raise ValueError(f"{address!r} is no address: write https://NAME, as browsers will find the service")
    is_local = host == "localhost"
    return {
        # Letters and digits: some of them stand in addresses.
        **{name: secrets.token_hex(24) for name in _SECRETS},
        "APEXCAL_PUBLIC_URL": address.rstrip("/"),
        "APEXCAL_S3_PUBLIC_ENDPOINT": f"https://blobs.{host}",
        # A browser asks about a page's unknown certificate, but not about that of a store that the page sends to.
        "APEXCAL_UPLOADS": "api" if is_local else "presigned",
        "APEXCAL_HTTP_PORT": "127.0.0.1:80" if is_local else "80",
        "APEXCAL_HTTPS_PORT": "127.0.0.1:443" if is_local else "443",
        "APEXCAL_BACKUPS": f"./{BACKUPS}",
        "APEXCAL_HOST_USER": f"{_IMAGE_USER}:{_IMAGE_USER}" if os.getuid() == 0 else f"{os.getuid()}:{os.getgid()}",
    }


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
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w") as file:
        file.write(text)


def main() -> None:
    """Write the files that are missing and say which."""
    parser = argparse.ArgumentParser(prog="python3 -m service.environment_file", description=__doc__)
    parser.add_argument("--address", default="https://localhost", help="where browsers find the service")
    address = parser.parse_args().address
    if ENVIRONMENT.exists():
        print(f"{ENVIRONMENT} exists and stays as it is")
    else:
        try:
            lines = [f"{name}={value}\n" for name, value in variables(address).items()]
        except ValueError as error:
            parser.error(str(error))
        _write_private(ENVIRONMENT, "".join(lines))
        print(f"{ENVIRONMENT} has new secrets and the address {address}")
    if IDENTITIES.exists():
        print(f"{IDENTITIES} exists and stays as it is")
    else:
        stated = dict(line.split("=", 1) for line in ENVIRONMENT.read_text().splitlines() if "=" in line)
        try:
            _write_private(IDENTITIES, identities(stated))
        except KeyError as error:
            parser.error(f"{ENVIRONMENT} lacks {error.args[0]}: add it, or remove {ENVIRONMENT} to get a new one")
        print(f"{IDENTITIES} has the store's keys out of {ENVIRONMENT}")
    BACKUPS.mkdir(mode=0o700, exist_ok=True)
    if os.getuid() == 0:
        for path in (IDENTITIES, BACKUPS):
            os.chown(path, _IMAGE_USER, _IMAGE_USER)


if __name__ == "__main__":
    main()
