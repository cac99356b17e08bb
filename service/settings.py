"""Typed settings, read from the environment. Service and workers read the same ones."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

MIB = 1024 * 1024


class Settings(BaseSettings):
    """Every variable is prefixed ``APEXCAL_``, for example ``APEXCAL_DATABASE_URL``."""

    model_config = SettingsConfigDict(env_prefix="APEXCAL_", extra="ignore")

    data_dir: Path = Field(default=Path("var/apexcal"), description="scratch space and, embedded, everything else")
    database_url: str = Field(default="", description="empty: SQLite in data_dir")
    broker_url: str = Field(default="", description="empty: the embedded broker's socket in data_dir")
    blob_url: str = Field(default="", description="empty: the folder `blobs` in data_dir")
    public_url: str = Field(default="http://127.0.0.1:8000", description="where people's browsers find the service")

    workers: int = Field(default_factory=lambda: max(2, os.cpu_count() or 2), description="pool processes, all hosts")
    lease_s: float = Field(default=10.0, description="how long a silent worker keeps its job")
    renew_s: float = Field(default=3.0, description="how often a worker renews its lease")
    resend_s: float = Field(default=10.0, description="first resend of an unclaimed job; doubles each time")
    sweep_s: float = Field(default=2.0, description="period of the sweep")
    max_lost_leases: int = Field(default=5, description="a job that loses this many leases fails")
    task_limit_s: int = Field(default=1800, description="a task that runs longer is ended and its lease expires")

    part_bytes: int = Field(default=16 * MIB, description="size of an upload part that clients are told to use")
    max_part_bytes: int = Field(default=64 * MIB, description="largest upload part that is accepted")
    min_free_bytes: int = Field(default=512 * MIB, description="uploads are answered with 507 below this")
    ingest_memory_bytes: int = Field(
        default=4096 * MIB, description="address space of a process that decodes uploads"
    )
    ingest_cpu_s: int = Field(default=1200, description="processor time of a process that decodes uploads")
    ingest_file_bytes: int = Field(default=16 * 1024 * MIB, description="largest file that such a process writes")

    mark_lease_s: float = Field(default=120.0, description="how long a person keeps a marking task unanswered")
    session_days: int = Field(default=30, description="a browser session ends after this many days")
    invitation_hours: int = Field(default=72, description="an unused sign-in link ends after this many hours")

    supervisor_status: Path | None = Field(default=None, description="where `apexcal serve` notes its children")

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
    def scratch(self) -> Path:
        """Folder for files that live as long as one task."""
        return self.data_dir.resolve() / "scratch"


@lru_cache(maxsize=1)
def get_settings() -> Settings:
    """The process's settings, read once."""
    return Settings()
