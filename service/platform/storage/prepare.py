"""``python -m service.platform.storage.prepare`` makes the bucket if it is missing, and tests that it can be written.

If a bucket needs policies of its own, its operator should make it beforehand. A folder is marked as the store of the
settings' database (``service.platform.storage.adopting``); the API also does that as it starts. ``--anew`` also marks
a folder that lacks the objects that the database names.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import timedelta
from typing import Literal
from urllib.parse import urlsplit

import httpx
import obstore
import obstore.exceptions
from sqlalchemy.exc import SQLAlchemyError

from service.platform.db.session import Database
from service.platform.settings import S3Options, Settings, settings_or_exit
from service.platform.storage.adopting import StrangeFolderError, adopt
from service.platform.storage.errors import StoreUnavailableError
from service.platform.storage.store import Store, open_store
from service.platform.storage.urls import open_bucket_root

_PROBE = "probe/prepare"
_OF_AMAZON = "<CreateBucketConfiguration><LocationConstraint>{}</LocationConstraint></CreateBucketConfiguration>"


def prepare(url: str, options: S3Options) -> bool:
    """Make the bucket of ``url`` if it is missing, test that the store can be written, and say whether it was made.

    Raises :class:`StoreUnavailableError` if the store still cannot be written.
    """
    parts = urlsplit(url)
    is_new = False
    store = Store(url, options)
    if parts.scheme == "s3" and not _is_there(parts.netloc, options):
        is_new = _make(parts.netloc, options)
    store.put_bytes(_PROBE, b"writable?")
    store.delete(_PROBE)
    return is_new


def _is_there(bucket: str, options: S3Options) -> bool:
    try:
        obstore.head(open_bucket_root(bucket, options), _PROBE)
    except FileNotFoundError:
        # An answer to HEAD has no body that tells a missing bucket from a missing object, so ask for the bucket.
        return httpx.head(_address("HEAD", bucket, options), timeout=options.timeout_s).is_success
    except obstore.exceptions.BaseError as error:
        raise StoreUnavailableError from error
    return True


def _make(bucket: str, options: S3Options) -> bool:
    abroad = not options.endpoint and options.region != "us-east-1"
    body = _OF_AMAZON.format(options.region) if abroad else ""
    answer = httpx.put(_address("PUT", bucket, options), content=body.encode(), timeout=options.timeout_s)
    # 409: somebody made it at the same moment. The probe tells whether we may write to it.
    if not answer.is_success and answer.status_code != httpx.codes.CONFLICT:
        raise StoreUnavailableError
    return answer.is_success


def _address(method: Literal["HEAD", "PUT"], bucket: str, options: S3Options) -> str:
    return obstore.sign(open_bucket_root(bucket, options), method, "", timedelta(minutes=1))


def _mark(settings: Settings, *, anew: bool) -> None:
    """Mark the folder of the settings. A bucket has no marker."""
    store = open_store(settings)
    if anew:
        store.prepare()
        return
    database = Database(settings.database, patient=True)
    try:
        adopt(database, store)
    finally:
        database.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """0 if the store can be written, otherwise 1."""
    parser = argparse.ArgumentParser(prog="python -m service.platform.storage.prepare", description=__doc__)
    parser.add_argument("--anew", action="store_true", help="mark a folder that lacks what the database names")
    chosen = parser.parse_args(arguments)
    settings = settings_or_exit()
    try:
        _mark(settings, anew=chosen.anew)
        is_new = prepare(settings.blobs, settings.s3)
    except StrangeFolderError as error:
        print(f"{error}. {error.hint}", file=sys.stderr)
        return 1
    except SQLAlchemyError as error:
        print(f"the database does not say what the folder should hold: {type(error).__name__}", file=sys.stderr)
        return 1
    except (OSError, httpx.TransportError) as error:  # the store's own errors among them
        print(f"the blob store at {settings.blobs} cannot be written: {error}", file=sys.stderr)
        return 1
    print(f"the blob store at {settings.blobs} can be written{'; its bucket was made' if is_new else ''}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
