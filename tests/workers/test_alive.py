"""The file that health checks of containers look at."""

import threading
from pathlib import Path

import pytest

from service.platform.settings import get_settings
from tests.support.processes import wait_until
from workers import alive


def test_a_worker_that_compiles_is_alive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "alive"
    monkeypatch.setenv("APEXCAL_ALIVE_FILE", str(file))
    monkeypatch.setattr(alive, "_EVERY_S", 0.02)
    get_settings.cache_clear()
    try:
        with alive.touched_meanwhile():
            wait_until(file.exists, "the file")
            before = file.stat().st_mtime_ns
            wait_until(lambda: file.stat().st_mtime_ns > before, "a younger file")
        assert "meanwhile" not in {thread.name for thread in threading.enumerate()}, "nobody touches it any more"
    finally:
        get_settings.cache_clear()
