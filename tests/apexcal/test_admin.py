"""``apexcal admin`` beside a running embedded service: where its folder may stand, and where its links lead."""

from __future__ import annotations

import fcntl
from pathlib import Path

import pytest

from apexcal.client import Client
from apexcal.commands.programs import data_first
from service.admin.__main__ import _made
from service.admin.context import AdminError
from service.admin.people_commands import public_url
from service.platform.settings import Settings
from tests.apexcal.test_cli import program
from tests.support.served import Embedded


@pytest.mark.parametrize(
    ("words", "moved"),
    [
        (["jobs", "--data", "x", "--json"], ["--data", "x", "jobs", "--json"]),
        (["job", "7", "--data=x"], ["--data=x", "job", "7"]),
        (["jobs", "--data"], ["jobs", "--data"]),
        (["users", "link", "--", "--data", "x"], ["users", "link", "--", "--data", "x"]),
    ],
)
def test_the_folder_may_stand_anywhere(words: list[str], moved: list[str]):
    assert data_first(words) == moved


def test_a_link_of_the_operator_leads_to_the_running_service(embedded: Embedded, owner: Client):
    made = program("admin", "users", "link", owner.me().id, "--data", embedded.data)
    assert made.returncode == 0, made.stderr
    assert f"{embedded.url}/sign-in#" in made.stdout
    assert made.stderr == ""


def test_an_address_is_known_where_it_is_stated_or_the_service_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name in ("APEXCAL_DATABASE_URL", "APEXCAL_PUBLIC_URL"):
        monkeypatch.delenv(name, raising=False)
    stopped = Settings(data_dir=tmp_path)
    assert public_url(stopped) == (stopped.public_url, False)
    (tmp_path / "supervisor.json").write_text('{"url": "x", "public_url": "http://127.0.0.1:4711"}')
    assert public_url(stopped) == (stopped.public_url, False), "a killed service leaves its status behind"
    with _made(tmp_path):
        pass
    with (tmp_path / "serve.lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert public_url(stopped) == ("http://127.0.0.1:4711", True)
        with pytest.raises(AdminError, match="a service runs on"), _made(tmp_path):
            pass
    stated = "https://cal.example.org"
    assert public_url(Settings(data_dir=tmp_path, public_url=stated)) == (stated, True)
