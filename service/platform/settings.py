"""Typed settings, read from the environment. Service and workers read the same ones."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from pydantic import AliasChoices, Field, SecretStr, ValidationError, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

MIB = 1024 * 1024
# Container engines mount each secret as a file with its variable's name. The environment has precedence.
_SECRETS = Path("/run/secrets")
_DATABASE = re.compile(r"(postgresql|sqlite)(\+\w+)?://")


@dataclass(frozen=True)
class S3Options:
    """Where the bucket is and how long to wait for it.

    ``public_endpoint`` is the same server's address for clients; presigned addresses carry it. Without keys, obstore
    looks for credentials itself: AWS_* variables, web identities, an instance's role.
    """

    endpoint: str = ""
    public_endpoint: str = ""
    region: str = "us-east-1"
    access_key_id: str = ""
    secret_access_key: str = field(default="", repr=False)
    timeout_s: float = 20.0


class Settings(BaseSettings):
    """Every variable is prefixed ``APEXCAL_``, for example ``APEXCAL_DATABASE_URL``."""

    model_config = SettingsConfigDict(
        env_prefix="APEXCAL_",
        extra="ignore",
        populate_by_name=True,
        secrets_dir=_SECRETS if _SECRETS.is_dir() else None,
    )

    data_dir: Path = Path("var/apexcal")
    """Scratch space and, embedded, everything else."""
    database_url: str = ""
    """Empty: SQLite in data_dir."""
    database_roles: dict[str, SecretStr] = {}
    """For migrations alone: roles of PostgreSQL to make, as JSON, with their passwords."""
    broker_url: str = ""
    """Empty: the embedded broker's socket in data_dir."""
    blob_url: str = ""
    """`s3://bucket/prefix`; empty: the folder `blobs` in data_dir."""
    public_url: str = "http://127.0.0.1:8000"
    """Where people's browsers find the service."""

    s3_endpoint: str = Field(
        default="", validation_alias=AliasChoices("APEXCAL_S3_ENDPOINT", "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
    )
    """Address of the S3 server; empty: Amazon's for the region."""
    s3_public_endpoint: str = ""
    """The same server's address for clients; empty: s3_endpoint."""
    s3_region: str = Field(
        default="us-east-1", validation_alias=AliasChoices("APEXCAL_S3_REGION", "AWS_REGION", "AWS_DEFAULT_REGION")
    )
    s3_access_key_id: str = Field(
        default="", validation_alias=AliasChoices("APEXCAL_S3_ACCESS_KEY_ID", "AWS_ACCESS_KEY_ID")
    )
    s3_secret_access_key: SecretStr = Field(
        default=SecretStr(""), validation_alias=AliasChoices("APEXCAL_S3_SECRET_ACCESS_KEY", "AWS_SECRET_ACCESS_KEY")
    )
    store_timeout_s: float = Field(default=20.0, gt=0)
    """Longest wait for one answer of S3."""
    uploads: Literal["presigned", "api"] = "presigned"
    """How parts reach S3: straight from the client, or through the API."""
    downloads: Literal["presigned", "api"] = "api"
    """How frames and originals leave S3: straight to the client, or through the API."""
    presigned_s: float = Field(default=900.0, ge=1, le=3600)
    """How long a presigned address works."""
    audit: Literal["remove", "report", "off"] = "remove"
    """What the audit of the store does with objects that no row knows."""
    audit_hours: float = Field(default=24.0, gt=0)
    """Period of that audit."""
    orphan_hours: float = Field(default=24.0, ge=1)
    """Younger objects are left alone by it."""

    lease_s: float = 10.0
    """How long a silent worker keeps its job."""
    renew_s: float = 3.0
    """How often a worker renews its lease."""
    resend_s: float = 10.0
    """First resend of an unclaimed job; doubles each time."""
    sweep_s: float = 2.0
    """Period of the reaper."""
    stalled_s: float = Field(default=180.0, gt=0)
    """Time without progress after which a sweeper ends, to be started again."""
    max_lost_leases: int = 5
    """A job that loses this many leases fails."""
    max_stumbles: int = 30
    """A job fails after this many failures of its database, store or disk: about an hour."""
    task_limit_s: int = 1800
    """A task that runs longer is ended and its lease expires."""
    calibration_hours: float = Field(default=24.0, gt=0)
    """Processor hours that one calibration may be predicted to take."""
    fleet_request_hours: float = Field(default=240.0, gt=0)
    """Processor hours that one fleet request may be predicted to take."""

    fleet_quota_bytes: int = Field(default=200 * 10**9, ge=0)
    """Quota of a fleet, unless `apexcal admin quota` sets another: a hundred recordings of a gigabyte, each stored as
    uploaded and as read."""
    upload_hours: float = Field(default=24.0, gt=0)
    """Time without a part after which an upload is removed."""
    fleet_ingests: int = Field(default=1, ge=1)
    """Recordings of one fleet read at once. If this is below the number of `ingest` processes, others have room."""
    part_bytes: int = 16 * MIB
    """Size of an upload part that clients are told to use."""
    max_part_bytes: int = 64 * MIB
    """Largest upload part that is accepted."""
    min_free_bytes: int = 512 * MIB
    """Uploads are answered with 507 below this."""
    ingest_memory_bytes: int = 4096 * MIB
    """Address space of a process that decodes uploads."""
    ingest_cpu_s: int = 1200
    """Processor time of a process that decodes uploads."""
    ingest_file_bytes: int = 16 * 1024 * MIB
    """Largest file that such a process writes."""
    ingest_wall_s: float = Field(default=120.0, gt=0)
    """Seconds by the clock that reading any upload may take."""
    ingest_wall_s_per_mib: float = Field(default=10.0, ge=0)
    """Further seconds for each MiB of it; never past four fifths of task_limit_s."""
    ingest_silence_s: float = Field(default=60.0, gt=0)
    """Time without progress after which such a process is ended."""
    ingest_output_ratio: float = Field(default=20.0, gt=0)
    """Bytes it may write for each byte uploaded."""
    ingest_video_ratio: float = Field(default=300.0, gt=0)
    """The same while it decodes video."""
    ingest_output_floor_bytes: int = Field(default=16 * MIB, gt=0)
    """Bytes it may write in any case."""

    celery_events: bool = True
    """Workers and senders tell Celery's events of each job."""
    celery_control: bool = False
    """Workers obey Celery's remote control: whoever reaches the broker can stop them."""

    mark_lease_s: float = 120.0
    """How long a person keeps a marking task unanswered."""
    log: Literal["", "text", "json"] = ""
    """Empty: json on PostgreSQL, else text."""
    metrics_token: SecretStr = SecretStr("")
    """Bearer token of /metrics; empty: open to the service's own host only."""
    drain_s: float = Field(default=0.0, ge=0)
    """How long /readyz says 503 before the API stops listening."""
    connections: int = Field(default=1000, ge=16)
    """Open connections of an API process."""
    job_days: int = Field(default=90, ge=1)
    """Ended jobs and their history go after this many days."""

    audit_days: int = Field(default=400, ge=1)
    """What the audit says of people's actions goes after this."""

    session_days: int = 30
    """A browser session ends after this many days."""
    invitation_hours: int = 72
    """An unused sign-in link ends after this many hours."""

    alive_file: Path | None = None
    """Touched by workers and the sweeper, for health checks."""
    supervisor_status: Path | None = None
    """Where `apexcal serve` notes its children."""

    @field_validator("database_url")
    @classmethod
    def _is_database(cls, url: str) -> str:
        if url and not _DATABASE.match(url):  # in words without the URL, which may hold a password
            raise ValueError("it looks like postgresql+psycopg://user:password@host/name or sqlite:///file")
        return url

    @field_validator("blob_url")
    @classmethod
    def _is_store(cls, url: str) -> str:
        if url:
            check_store_url(url)
        return url

    @property
    def database(self) -> str:
        """SQLAlchemy URL of the database."""
        return self.database_url or f"sqlite:///{self.data_dir.resolve() / 'apexcal.db'}"

    @property
    def broker(self) -> str:
        """Celery URL of the broker."""
        return self.broker_url or f"redis+socket://{self.data_dir.resolve() / 'broker.sock'}?virtual_host=0"

    @property
    def events(self) -> str:
        """redis-py URL of the same server, for publish and subscribe."""
        return self.broker.replace("redis+socket://", "unix://").replace("virtual_host=", "db=")

    @property
    def blobs(self) -> str:
        """obstore URL of the blob store."""
        return self.blob_url or (self.data_dir.resolve() / "blobs").as_uri()

    @property
    def s3(self) -> S3Options:
        """Return how the bucket is reached, if the blob store is one."""
        return S3Options(
            endpoint=self.s3_endpoint,
            public_endpoint=self.s3_public_endpoint,
            region=self.s3_region,
            access_key_id=self.s3_access_key_id,
            secret_access_key=self.s3_secret_access_key.get_secret_value(),
            timeout_s=self.store_timeout_s,
        )

    @property
    def log_form(self) -> Literal["text", "json"]:
        """Return the form of log lines: JSON for a fleet, whose logs machines read."""
        return self.log or ("text" if self.database.startswith("sqlite") else "json")

    @property
    def scratch(self) -> Path:
        """Folder for files that live as long as one task."""
        return self.data_dir.resolve() / "scratch"


def check_store_url(url: str) -> None:
    """Raises ValueError for a URL that names no store."""
    parts = urlsplit(url)
    if not ((parts.scheme == "file" and parts.path) or (parts.scheme == "s3" and parts.netloc)):
        raise ValueError(f"{url!r} names no store; one looks like file:///folder or s3://bucket/prefix")


class SettingsError(Exception):
    """Variables of the environment that cannot be used: a sentence for each."""


@lru_cache(maxsize=1)
def get_settings() -> Settings:
    """The process's settings, read once. Raises :class:`SettingsError`."""
    try:
        return Settings()
    except ValidationError as error:
        raise SettingsError(
            "; ".join(_sentence(str(fault["loc"][0]), fault["msg"]) for fault in error.errors())
        ) from None


def settings_or_exit() -> Settings:
    """Return the settings, or end the process with exit code 2. Its last line then says what is wrong with them."""
    try:
        return get_settings()
    except SettingsError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None


def _sentence(name: str, wrong: str) -> str:
    """Say what is wrong with a variable, without its value, which may be a secret."""
    variable = name if name.isupper() else f"APEXCAL_{name.upper()}"
    return f"{variable} cannot be used: {wrong.removeprefix('Value error, ')}"
