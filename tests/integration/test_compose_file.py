"""docker-compose.yml against what compose takes and what we promise of it; no engine runs here."""

import importlib
import importlib.util
import json
import re
import shutil
import subprocess

import pytest
import yaml

from apexcal.embedded.folder import DataFolder
from apexcal.embedded.plans import QUEUES, api
from service.environment_file import IDENTITIES
from service.environment_file import identities as identities_of
from service.platform.db.grants import OF_INGEST
from service.platform.settings import Settings
from tests.containers.local_images import OVERRIDE, localised
from tests.support.compose import FILE, ROOT, MissingVariableError, demanded, image_environment, load

VARIABLES = {name: f"given-{name.lower().replace('_', '-')}" for name in demanded()}
# What each service may say, out of the Compose Specification: a misspelt word would be ignored or refused.
KEYS = {
    *("image", "build", "user", "entrypoint", "command", "environment", "volumes", "networks", "ports", "depends_on"),
    *("restart", "init", "read_only", "tmpfs", "cap_drop", "security_opt", "shm_size", "mem_limit", "pids_limit"),
    *("stop_grace_period", "healthcheck", "logging", "cpu_shares", "configs", "profiles", "cap_add", "working_dir"),
}
# A tag may be moved to another image; the digest is the image. The tag says to people which one it is.
PINNED = r":\d+(\.\d+)+[a-z-]*@sha256:[0-9a-f]{64}$"
HEALTH = {"test", "interval", "timeout", "retries", "start_period"}
ONCE = {"migrations", "bucket", "durable", "kernels", "backup", "restore"}
# An official image whose binary has a file capability starts only where that capability may be had.
CAPABILITIES = {"proxy": ["NET_BIND_SERVICE"]}


@pytest.fixture(scope="module")
def document() -> dict:
    return load(VARIABLES)


@pytest.fixture(scope="module")
def services(document: dict) -> dict[str, dict]:
    return document["services"]


def ours(services: dict[str, dict]) -> dict[str, dict]:
    return {name: service for name, service in services.items() if "build" in service}


def test_it_refuses_to_start_without_secrets() -> None:
    secrets = {"POSTGRES_PASSWORD", "API_DATABASE_PASSWORD", "WORKER_DATABASE_PASSWORD", "VALKEY_PASSWORD"}
    secrets |= {
        "INGEST_DATABASE_PASSWORD",
        "S3_ACCESS_KEY",
        "S3_SECRET_KEY",
        "S3_WORKER_ACCESS_KEY",
        "S3_WORKER_SECRET_KEY",
    }
    assert demanded() == secrets | {"APEXCAL_PUBLIC_URL", "APEXCAL_S3_PUBLIC_ENDPOINT"}
    for name in demanded():
        with pytest.raises(MissingVariableError, match=name):
            load(VARIABLES | {name: ""})
    text = FILE.read_text()
    for name in secrets:
        assert not re.search(rf"\$\{{{name}(?!:\?)", text), f"{name} has a default somewhere"


def test_every_word_is_one_that_compose_knows(document: dict, services: dict[str, dict]) -> None:
    extensions = {key for key in document if key.startswith("x-")}
    assert set(document) - extensions == {"services", "networks", "volumes", "configs"}
    for name, service in services.items():
        assert set(service) <= KEYS, (name, set(service) - KEYS)
        assert set(service.get("healthcheck", {})) <= HEALTH, name
        assert set(service["networks"]) <= set(document["networks"]), name
        for volume in service.get("volumes", []):
            source, _, target = volume.rpartition(":")
            assert target.startswith("/") and (not source or source in document["volumes"]), (name, volume)
        for other, wanted in service.get("depends_on", {}).items():
            condition = wanted["condition"]
            assert condition in ("service_healthy", "service_completed_successfully"), (name, other)
            assert (condition == "service_healthy") == ("healthcheck" in services[other]), (name, other)
            assert (condition == "service_completed_successfully") == (other in ONCE), (name, other)


def test_containers_can_do_little(services: dict[str, dict]) -> None:
    for name, service in services.items():
        assert service["read_only"] is True and "/tmp" in service["tmpfs"], name
        assert service["cap_drop"] == ["ALL"] and service["security_opt"] == ["no-new-privileges:true"], name
        assert service.get("cap_add") == CAPABILITIES.get(name), name
        assert service["user"] not in ("root", "0", "0:0") and service["user"], name
        assert re.fullmatch(r"\d+[mg]", service["mem_limit"]), name
        assert 128 <= service["pids_limit"] <= 4096, name
        pinned = PINNED if "build" not in service else r":\d+(\.\d+)+$"
        assert re.search(pinned, service["image"]), f"{name}: pin {service['image']} to a version and its digest"
        assert service["restart"] == ("no" if name in ONCE else "unless-stopped"), name
        assert ("healthcheck" in service) == (name not in ONCE), name


def test_images_are_built_on_a_pinned_one() -> None:
    bases = [line.split()[1] for line in (ROOT / "Dockerfile").read_text().splitlines() if line.startswith("FROM ")]
    assert len(bases) == 2 and len(set(bases)) == 1
    assert re.search(PINNED, bases[0]), bases[0]


def test_stand_ins_for_images_change_nothing_else(services: dict[str, dict]) -> None:
    override = yaml.safe_load(OVERRIDE.read_text())
    assert {key for key in override if not key.startswith("x-")} == {"services"}
    assert set(override["services"]) == set(services)
    for name, service in override["services"].items():
        assert set(service) == ({"build"} if "build" in services[name] else {"image"}), name
    text = (ROOT / "Dockerfile").read_text()
    pairs = list(zip(text.splitlines(), localised(text).splitlines(), strict=True))
    changed = [ours for ours, local in pairs if ours != local]
    assert len(changed) == 2 and all(line.startswith("FROM python:") for line in changed)


def test_the_image_has_all_that_its_build_reads() -> None:
    """What the pages' build reads outside of `frontend` is copied, and not held back from the copy."""
    copied = re.findall(r"^COPY ([a-z]+) ", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    read = re.findall(r'"\.\./([a-z]+)[/"]', (ROOT / "frontend" / "vite.config.ts").read_text())
    held_back = (ROOT / ".dockerignore").read_text().split()
    assert set(read) - {"service", "workers"} <= set(copied) and not set(copied) & set(held_back)


def test_only_the_doors_are_open(document: dict, services: dict[str, dict]) -> None:
    closed = [name for name, network in document["networks"].items() if network == {"internal": True}]
    assert set(document["networks"]) - set(closed) == {"outside"}
    outside = {name for name, service in services.items() if "outside" in service["networks"]}
    assert outside == {name for name, service in services.items() if "ports" in service} == {"proxy"}
    members = {network: {name for name, one in services.items() if network in one["networks"]} for network in closed}
    assert members["store"] == {"store", "s3", "durable"}, "its own ports ask for no password"
    assert members["door"] == {"proxy", "api", "api-2", "s3"}
    for service in services.values():
        for port in service.get("ports", []):
            assert port.startswith("127.0.0.1:"), "a door is open to other hosts only where the operator says so"


def test_who_decodes_uploads_meets_only_what_it_works_with(services: dict[str, dict]) -> None:
    assert services["worker-ingest"]["networks"] == ["ingest"]
    met = {name for name, service in services.items() if "ingest" in service["networks"]}
    assert met == {"worker-ingest", "postgres", "valkey", "s3"}


def test_each_part_has_a_role_and_keys_of_its_own(document: dict, services: dict[str, dict]) -> None:
    users = {
        name: one["environment"]["APEXCAL_DATABASE_URL"].split("//")[1].split(":")[0]
        for name, one in ours(services).items()
    }
    assert {name for name, user in users.items() if user == "apexcal"} == {"migrations", "restore"}
    assert {name for name, user in users.items() if user == "apexcal_api"} == {"api", "api-2", "backup", "bucket"}
    assert {name for name, user in users.items() if user == OF_INGEST} == {"worker-ingest"}
    keys = {name: one["environment"]["APEXCAL_S3_ACCESS_KEY_ID"] for name, one in ours(services).items()}
    assert {name for name, key in keys.items() if key == VARIABLES["S3_ACCESS_KEY"]} == {
        "api",
        "api-2",
        "backup",
        "restore",
        "bucket",
    }
    assert document["configs"]["identities"] == {"file": f"./{IDENTITIES}"}
    identities = json.loads(identities_of(VARIABLES))["identities"]
    actions = {one["credentials"][0]["accessKey"]: one["actions"] for one in identities}
    assert not any("Admin" in action for action in actions[VARIABLES["S3_WORKER_ACCESS_KEY"]])
    assert set(json.loads(services["migrations"]["environment"]["APEXCAL_DATABASE_ROLES"])) == {*users.values()} - {
        "apexcal"
    }


def test_every_queue_has_its_workers_and_time_to_let_go(services: dict[str, dict]) -> None:
    workers = {name: service for name, service in services.items() if name.startswith("worker-")}
    queues = [service["command"][service["command"].index("--queues") + 1] for service in workers.values()]
    assert sorted(queues) == sorted(QUEUES.split(","))
    for name, service in workers.items():
        assert len(service["networks"]) == 1 and "outside" not in service["networks"], name
        assert service["stop_grace_period"] == "60s", name
        assert any(volume.endswith(":/var/cache/apexcal") for volume in service["volumes"]), name
        assert "/var/lib/apexcal" in service["volumes"], name
    sweepers = [name for name, service in services.items() if "workers.sweeper" in (service.get("command") or [])]
    assert sweepers == ["sweeper"]


def test_the_api_lets_nobody_wait_for_ever_and_logs_are_bounded(services: dict[str, dict]) -> None:
    embedded = api(DataFolder(ROOT), {}, "127.0.0.1", 1).command
    protocol = embedded[embedded.index("--http") + 1]
    assert (
        f"--http={protocol}" in services["api"]["command"]
        and f"--http={protocol}" in (ROOT / "Dockerfile").read_text()
    )
    module, _, name = protocol.partition(":")
    assert hasattr(importlib.import_module(module), name)
    for service in services.values():
        assert set(service["logging"]["options"]) == {"max-size", "max-file"}


def test_settings_and_modules_exist(services: dict[str, dict]) -> None:
    known = {f"APEXCAL_{name.upper()}" for name in Settings.model_fields}
    for name, service in ours(services).items():
        settings = {key for key in service["environment"] if key.startswith("APEXCAL_")}
        assert settings <= known, (name, settings - known)
        words = service["command"]
        for flag in ("-m", "-A"):
            if flag in words:
                module = words[words.index(flag) + 1]
                assert importlib.util.find_spec(module), (name, module)
    assert image_environment()["APEXCAL_DATA_DIR"] == "/var/lib/apexcal"
    assert all(line != "USER root" for line in (ROOT / "Dockerfile").read_text().splitlines())
    assert "USER 1000:1000" in (ROOT / "Dockerfile").read_text()
    assert ".env" in (ROOT / ".dockerignore").read_text().split()


def test_compose_itself_takes_it() -> None:
    tool = shutil.which("docker-compose")
    plugin = shutil.which("docker") and subprocess.run(["docker", "compose", "version"], capture_output=True)
    command = [tool] if tool else ["docker", "compose"] if plugin and plugin.returncode == 0 else None
    if command is None:
        pytest.skip("neither docker-compose nor docker's compose plugin is installed")
    environment = {"PATH": "/usr/local/bin:/usr/bin:/bin", **VARIABLES}
    answer = subprocess.run([*command, "-f", str(FILE), "config"], capture_output=True, text=True, env=environment)
    assert answer.returncode == 0, answer.stderr
    assert set(yaml.safe_load(answer.stdout)["services"]) == set(load(VARIABLES)["services"])
    missing = {name: value for name, value in environment.items() if name != "S3_SECRET_KEY"}
    refused = subprocess.run([*command, "-f", str(FILE), "config"], capture_output=True, text=True, env=missing)
    assert refused.returncode != 0 and "S3_SECRET_KEY" in refused.stderr
