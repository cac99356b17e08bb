"""Settings that cannot be used, and a store that is away: sentences and exit codes, not tracebacks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from service.admin import __main__ as commands
from service.platform.db.models import Blob
from service.platform.db.session import Database
from service.platform.settings import get_settings
from tests.support.processes import free_port


def typed(*words: str) -> Result:
    return CliRunner().invoke(commands.app, list(words), prog_name="apexcal admin")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("APEXCAL_BLOB_URL", "ftp://x", "s3://bucket/prefix"),
        ("APEXCAL_PART_BYTES", "abc", "valid integer"),
        ("APEXCAL_DATABASE_URL", "mysql://u:hidden@h/d", "sqlite:///file"),
        ("APEXCAL_DATABASE_URL", "hidden", "sqlite:///file"),
    ],
)
def test_settings_that_cannot_be_used_are_named(monkeypatch: pytest.MonkeyPatch, name: str, value: str, words: str):
    monkeypatch.setenv(name, value)
    get_settings.cache_clear()
    found = typed("users", "list")
    assert found.exit_code == 2, found.output
    assert f"apexcal admin: {name} cannot be used" in found.stderr and words in found.stderr
    assert "hidden" not in found.stderr, "a password"
    get_settings.cache_clear()


@pytest.mark.parametrize(
    "program",
    [
        "service.platform.auth.bootstrap",
        "service.platform.storage.prepare",
        "celery -A workers.app",
        "workers.sweeper",
    ],
)
def test_programs_end_with_a_sentence_where_settings_cannot_be_used(program: str):
    environment = {**os.environ, "APEXCAL_PART_BYTES": "abc"}
    ended = subprocess.run(
        [sys.executable, "-m", *program.split(), *(["worker"] if "celery" in program else [])],
        capture_output=True, text=True, env=environment,
    )  # fmt: skip
    assert ended.returncode == 2 and "Traceback" not in ended.stderr, ended.stderr
    assert ended.stderr.startswith("APEXCAL_PART_BYTES cannot be used"), ended.stderr


def test_a_store_that_is_away_is_no_disk(database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with database.writing() as session:
        session.add(Blob(key="recordings/x", state="stored", size=1))
    monkeypatch.setattr("service.admin.objects.PAUSES_S", (0.0,))
    monkeypatch.setenv("APEXCAL_BLOB_URL", "s3://bucket")
    monkeypatch.setenv("APEXCAL_S3_ENDPOINT", f"http://127.0.0.1:{free_port()}")
    monkeypatch.setenv("APEXCAL_S3_ACCESS_KEY_ID", "a")
    monkeypatch.setenv("APEXCAL_S3_SECRET_ACCESS_KEY", "s")
    monkeypatch.setenv("APEXCAL_STORE_TIMEOUT_S", "0.5")
    get_settings.cache_clear()
    target = tmp_path / "backup"
    found = typed("backup", str(target))
    assert found.exit_code == 1 and not target.exists()
    assert "apexcal admin: the blob store does not answer" in found.stderr and "s3://bucket" in found.stderr
