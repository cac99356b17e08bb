"""Which folder a service takes for its own as it starts."""

from pathlib import Path

import pytest

from service.app import create_app
from service.platform.db.recordings import Blob
from service.platform.db.session import Database
from service.platform.settings import Settings
from service.platform.storage import prepare
from service.platform.storage.adopting import StrangeFolderError, adopt, adopt_if_known
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


def test_an_empty_folder_and_one_from_before_the_marker_are_taken(
    database: Database, settings: Settings, folder: Path
) -> None:
    store = Store(folder.as_uri())
    adopt(database, store)
    store.put_bytes("a/b", b"x")
    with database.writing() as session:
        session.add(Blob(key="a/b", state="stored"))
    (folder / MARKER).unlink()
    create_app(settings)
    assert store.is_prepared()


def test_an_empty_folder_beside_a_database_that_knows_objects_is_refused(
    database: Database, settings: Settings, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    with database.writing() as session:
        session.add_all(Blob(key=f"a/{number}", state="stored") for number in range(3))
    with pytest.raises(StrangeFolderError, match="of the 3 objects"):
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


def test_a_folder_that_cannot_be_looked_into_is_not_called_strange(
    database: Database, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    with database.writing() as session:
        session.add(Blob(key="loop/b", state="stored"))
    (folder / "loop").symlink_to(folder / "loop")  # a read error: too many levels of links
    store = Store(folder.as_uri())
    adopt_if_known(database, store)
    assert not store.is_prepared()
    monkeypatch.setattr("sys.argv", ["prepare"])
    assert prepare.main() == 1
    assert "links" in capsys.readouterr().err
