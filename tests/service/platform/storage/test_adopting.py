"""Which folder a service takes for its own as it starts."""

from pathlib import Path

import pytest

from service.app import create_app
from service.platform.db.recordings import Blob
from service.platform.db.session import Database
from service.platform.settings import Settings
from service.platform.storage import prepare
from service.platform.storage.adopting import StrangeFolderError, adopt_if_known
from service.platform.storage.store import MARKER, Store, open_store

# What differs between the databases is not asked for.
pytestmark = pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)


@pytest.fixture
def folder(settings: Settings) -> Path:
    """The settings' folder as a disk that was never prepared."""
    found = open_store(settings).folder
    assert found
    (found / MARKER).unlink()
    return found


def test_an_empty_folder_is_taken_at_the_first_start(database: Database, settings: Settings, folder: Path) -> None:
    create_app(settings)
    assert (folder / MARKER).is_file()


def test_an_empty_folder_beside_a_database_that_knows_objects_is_refused(
    database: Database, settings: Settings, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    with database.writing() as session:
        session.add_all(Blob(key=f"a/{number}", state="stored") for number in range(3))
    with pytest.raises(StrangeFolderError, match="names 3 objects"):
        create_app(settings)
    monkeypatch.setattr("sys.argv", ["prepare"])
    assert prepare.main() == 1
    told = capsys.readouterr().err
    assert str(folder) in told and "disk mounted" in told and "--anew" in told
    assert list(folder.iterdir()) == []
    monkeypatch.setattr("sys.argv", ["prepare", "--anew"])
    assert prepare.main() == 0
    create_app(settings)


def test_without_its_database_a_folder_waits(settings: Settings, folder: Path, tmp_path: Path) -> None:
    store = Store(folder.as_uri())
    away = Database(f"sqlite:///{tmp_path / 'none' / 'apexcal.db'}")
    adopt_if_known(away, store)
    assert not store.is_prepared()
