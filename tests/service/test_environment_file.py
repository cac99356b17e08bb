"""`make env`: what docker-compose.yml demands, once."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from service.environment_file import stated, variables
from tests.support.compose import ROOT, demanded, load

COMMAND = [sys.executable, "-m", "service.environment_file"]


def write(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT)}
    return subprocess.run([*COMMAND, *words], cwd=folder, env=environment, capture_output=True, text=True)


def test_it_writes_all_that_the_file_demands_and_nobody_else_reads_it(tmp_path: Path) -> None:
    assert write(tmp_path).returncode == 0
    environment = stated((tmp_path / ".env").read_text())
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
    assert len(set(secrets)) == 9 and all(len(value) >= 32 and value.isalnum() for value in secrets)


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


def test_an_older_file_gets_what_it_lacks_and_its_values_are_read_as_compose_reads_them(tmp_path: Path) -> None:
    old = "# ours\nexport S3_ACCESS_KEY='of us' # the API\nS3_SECRET_KEY = \"a#b\"\nS3_WORKER_ACCESS_KEY=w=1 # work\n"
    old += "POSTGRES_PASSWORD=p\nAPEXCAL_PUBLIC_URL=https://calibration.example.org"
    (tmp_path / ".env").write_text(old)
    done = write(tmp_path)
    assert done.returncode == 0 and "APEXCAL_HOST_USER, APEXCAL_BACKUPS added" in done.stdout, done.stderr
    text = (tmp_path / ".env").read_text()
    assert text.startswith(old + "\n"), "a line stays as it is"
    environment = stated(text)
    # Who reads store-identities.json, which nobody else may.
    owner = (tmp_path / "store-identities.json").stat()
    assert environment["APEXCAL_HOST_USER"] == f"{owner.st_uid}:{owner.st_gid}"
    assert demanded() - set(environment) == {"APEXCAL_S3_PUBLIC_ENDPOINT"}, "an address is the operator's to say"
    assert not {"APEXCAL_HTTPS_PORT", "APEXCAL_UPLOADS", "APEXCAL_METRICS_TOKEN"} & set(environment)
    identities = json.loads((tmp_path / "store-identities.json").read_text())["identities"]
    (api, workers) = (one["credentials"][0] for one in identities)
    assert (api, workers["accessKey"]) == ({"accessKey": "of us", "secretKey": "a#b"}, "w=1")
    assert write(tmp_path).stdout.count("stays as it is\n") == 2 and (tmp_path / ".env").read_text() == text


def test_a_name_that_others_reach_sends_parts_to_the_store_and_opens_the_doors() -> None:
    environment = variables("https://calibration.example.org")
    assert environment["APEXCAL_S3_PUBLIC_ENDPOINT"] == "https://blobs.calibration.example.org"
    assert environment["APEXCAL_UPLOADS"] == "presigned" and environment["APEXCAL_HTTPS_PORT"] == "443"
    assert variables("https://localhost")["APEXCAL_HTTPS_PORT"].startswith("127.0.0.1:")
    assert variables("https://Calibration.Example.org/")["APEXCAL_PUBLIC_URL"] == "https://calibration.example.org"


@pytest.mark.parametrize(
    "address",
    [
        *("calibration.example.org", "http://calibration.example.org", "https://", "https://a b", "https://-a.org"),
        # The proxy would listen on another port than the one that is open, and two names need a name.
        *("https://localhost:8443", "https://example.org:443", "https://10.0.0.1", "https://[::1]", "https://::1"),
        *("https://example.org/calibration", "https://example.org?a", "https://me@example.org", "https://a.org."),
    ],
)
def test_an_address_that_the_compose_file_cannot_serve_is_refused(tmp_path: Path, address: str) -> None:
    refused = write(tmp_path, "--address", address)
    assert refused.returncode == 2 and "write https://NAME" in refused.stderr
    assert not (tmp_path / ".env").exists()
