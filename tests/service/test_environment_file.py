"""`make env`: what docker-compose.yml demands, once."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from service.environment_file import variables
from tests.support.compose import ROOT, demanded, load

COMMAND = [sys.executable, "-m", "service.environment_file"]


def write(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT)}
    return subprocess.run([*COMMAND, *words], cwd=folder, env=environment, capture_output=True, text=True)


def stated(folder: Path) -> dict[str, str]:
    return dict(line.split("=", 1) for line in (folder / ".env").read_text().splitlines())


def test_it_writes_all_that_the_file_demands_and_nobody_else_reads_it(tmp_path: Path) -> None:
    assert write(tmp_path).returncode == 0
    environment = stated(tmp_path)
    assert demanded() <= set(environment)
    document = load(environment)
    assert document["services"]["api"]["environment"]["APEXCAL_UPLOADS"] == "api"
    for name in (".env", "store-identities.json"):
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o600
    api, workers = json.loads((tmp_path / "store-identities.json").read_text())["identities"]
    assert api["credentials"][0]["secretKey"] == environment["S3_SECRET_KEY"]
    assert workers["credentials"][0]["accessKey"] == environment["S3_WORKER_ACCESS_KEY"]
    assert (tmp_path / "backups").is_dir()
    secrets = [value for name, value in environment.items() if not name.startswith("APEXCAL_")]
    assert len(set(secrets)) == 8 and all(len(value) >= 32 and value.isalnum() for value in secrets)


def test_it_never_replaces_what_is_there(tmp_path: Path) -> None:
    write(tmp_path)
    before = {name: (tmp_path / name).read_bytes() for name in (".env", "store-identities.json")}
    again = write(tmp_path, "--address", "https://calibration.example.org")
    assert again.returncode == 0 and again.stdout.count("stays as it is") == 2
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    # Keys changed in .env reach the store by a new file.
    (tmp_path / "store-identities.json").unlink()
    assert write(tmp_path).returncode == 0
    assert (tmp_path / "store-identities.json").read_bytes() == before["store-identities.json"]
    (tmp_path / "store-identities.json").unlink()
    (tmp_path / ".env").write_text("S3_ACCESS_KEY=a\n")
    refused = write(tmp_path)
    assert refused.returncode == 2 and "lacks S3_SECRET_KEY" in refused.stderr


def test_a_name_that_others_reach_sends_parts_to_the_store_and_opens_the_doors() -> None:
    environment = variables("https://calibration.example.org")
    assert environment["APEXCAL_S3_PUBLIC_ENDPOINT"] == "https://blobs.calibration.example.org"
    assert environment["APEXCAL_UPLOADS"] == "presigned" and environment["APEXCAL_HTTPS_PORT"] == "443"
    assert variables("https://localhost")["APEXCAL_HTTPS_PORT"].startswith("127.0.0.1:")
    with pytest.raises(ValueError, match="https://NAME"):
        variables("calibration.example.org")
