"""Open the store behind a URL: a folder, or a bucket of S3 or of a store with S3's interface."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from obstore.store import LocalStore, S3Store

from service.platform.settings import S3Options, check_store_url

if TYPE_CHECKING:
    # obstore has these for type checkers only.
    from obstore.store import ClientConfig, RetryConfig, S3Config

_CONNECT_S = 5.0


@dataclass(frozen=True)
class OpenStore:
    """A store with its folder, or with the bucket that signs addresses for clients and the origin that they see."""

    store: LocalStore | S3Store
    folder: Path | None = None
    signer: S3Store | None = None
    origin: str = ""


def open_url(url: str, options: S3Options) -> OpenStore:
    """Open ``file:///folder``, which is made if missing, or ``s3://bucket/prefix``. This sends nothing to S3.

    Raises ValueError for any other URL.
    """
    check_store_url(url)
    parts = urlsplit(url)
    if parts.scheme == "file":
        folder = Path(unquote(parts.path))
        return OpenStore(LocalStore(folder, mkdir=True), folder=folder)
    prefix = unquote(parts.path).strip("/") or None
    public = options.public_endpoint or options.endpoint or f"https://s3.{options.region}.amazonaws.com"
    origin = "{0.scheme}://{0.netloc}".format(urlsplit(public))
    signer = _bucket(parts.netloc, prefix, options, public)
    return OpenStore(_bucket(parts.netloc, prefix, options, options.endpoint), signer=signer, origin=origin)


def open_bucket_root(bucket: str, options: S3Options) -> S3Store:
    """Return the bucket itself. The signed address of its empty key is the bucket's: a PUT there makes the bucket."""
    return _bucket(bucket, None, options, options.endpoint)


def _bucket(bucket: str, prefix: str | None, options: S3Options, endpoint: str) -> S3Store:
    config: S3Config = {"region": options.region}
    if endpoint:
        config["endpoint"] = endpoint
    if options.access_key_id:
        config["access_key_id"] = options.access_key_id
        config["secret_access_key"] = options.secret_access_key
    # A request may take `timeout_s`, and none is repeated after that time, so a caller waits for twice as long at
    # most. Bodies are at most a few MiB, so the limit on a request's time is no limit on honest bodies.
    patience = timedelta(seconds=options.timeout_s)
    client: ClientConfig = {
        "allow_http": endpoint.startswith("http://"),
        "connect_timeout": timedelta(seconds=min(_CONNECT_S, options.timeout_s)),
        "timeout": patience,
    }
    retries: RetryConfig = {
        "max_retries": 4,
        "retry_timeout": patience,
        "backoff": {"init_backoff": timedelta(milliseconds=200), "max_backoff": timedelta(seconds=2), "base": 2},
    }
    return S3Store(bucket, prefix=prefix, config=config, client_options=client, retry_config=retries)
