"""A store for sweeps."""

from pathlib import Path

import pytest

from service.platform.storage.store import Store
from tests.support.folders import folder_store


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty folder."""
    return folder_store(tmp_path / "blobs")
