"""A store in a folder, as the service has prepared it."""

from pathlib import Path

from service.platform.storage.store import Store


def folder_store(path: Path) -> Store:
    """The store of this folder, marked as one."""
    store = Store(path.as_uri())
    store.prepare()
    return store
