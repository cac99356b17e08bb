"""The store: the same promises on a folder and on S3."""

import asyncio
import os
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import httpx
import pytest

from service.platform.settings import MIB, S3Options, Settings
from service.platform.storage.errors import MissingBlobError, StoreFullError, StoreUnavailableError
from service.platform.storage.lengths import signed
from service.platform.storage.prepare import prepare
from service.platform.storage.store import MARKER, Store
from tests.support.folders import folder_store
from tests.support.processes import free_port
from tests.support.s3 import S3Server

LARGE = os.urandom(9 * MIB + 1)


@pytest.fixture(params=["folder", "s3"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    if request.param == "folder":
        return folder_store(tmp_path / "blobs")
    server: S3Server = request.getfixturevalue("s3_server")
    return server.store()


async def chunks(data: bytes, size: int = 300_000) -> AsyncIterator[bytes]:
    for start in range(0, len(data), size):
        yield data[start : start + size]


async def joined(pieces: AsyncIterator[bytes]) -> bytes:
    return b"".join([piece async for piece in pieces])


def test_what_was_written_is_read_back(store: Store, tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.write_bytes(LARGE)
    assert store.put_file("a/file", source) == len(LARGE)
    asyncio.run(store.put_stream("a/stream", chunks(LARGE)))
    store.put_bytes("a/bytes", b"small")
    for key in ("a/file", "a/stream"):
        assert b"".join(store.stream(key)) == LARGE
        assert asyncio.run(joined(store.read_all(key))) == LARGE
        assert asyncio.run(store.size(key)) == len(LARGE)
    assert store.get_range("a/file", 8 * MIB - 5, 10) == LARGE[8 * MIB - 5 : 8 * MIB + 5]
    assert asyncio.run(joined(store.read_all("a/bytes", 1, 3))) == b"mal"
    assert asyncio.run(joined(store.read_all("a/file", 5, len(LARGE) - 7))) == LARGE[5:-2]
    asyncio.run(store.copy("a/stream", "b/copy"))
    store.put_bytes("a/stream", b"other bytes")
    assert b"".join(store.stream("b/copy")) == LARGE
    asyncio.run(store.put_stream("a/stream", chunks(LARGE)))
    store.delete("b/copy")
    assert {(one.key, one.size) for one in store.list()} == {
        ("a/file", len(LARGE)),
        ("a/stream", len(LARGE)),
        ("a/bytes", 5),
    }
    assert all(abs(one.modified.timestamp() - time.time()) < 60 for one in store.list())


def test_no_more_than_a_piece_of_an_object_is_held_at_once(store: Store) -> None:
    async def sizes() -> list[int]:
        return [len(piece) async for piece in store.read_all("a/frame", 3, 20 * MIB)]

    store.put_bytes("a/frame", bytes(24 * MIB))
    assert asyncio.run(sizes()) == [2 * MIB] * 10


def test_what_is_missing_or_cut_is_said_so(store: Store) -> None:
    store.put_bytes("a/short", b"12345")
    looks = (
        lambda: asyncio.run(store.size("a/none")),
        lambda: asyncio.run(store.copy("a/none", "a/copy")),
        lambda: asyncio.run(joined(store.read_all("a/none", 0, 1))),
        lambda: asyncio.run(joined(store.read_all("a/short", 3, 3))),
        lambda: asyncio.run(joined(store.read_all("a/none"))),
        lambda: list(store.stream("a/none")),
        lambda: store.get_range("a/none", 0, 1),
        lambda: store.get_range("a/short", 3, 3),
        lambda: store.get_range("a/short", 7, 3),
    )
    for look in looks:
        with pytest.raises(MissingBlobError) as found:
            look()
        assert found.value.key in found.value.hint
    store.delete("a/none")
    store.delete("a/short")
    store.delete("a/short")
    assert list(store.list()) == []


def test_an_interrupted_write_is_listed_and_removed(tmp_path: Path) -> None:
    store = folder_store(tmp_path / "blobs")
    store.put_bytes("a/b", b"whole")
    (tmp_path / "blobs/a/b#1").write_bytes(b"half")
    (tmp_path / "blobs/a/c#7").write_bytes(b"other half")
    assert {one.key for one in store.list()} == {"a/b", "a/b#1", "a/c#7"}
    store.delete("a/c#7")
    store.delete("a/b")
    assert list(store.list()) == []


def test_presigned_addresses_take_and_give_bytes(s3_server: S3Server) -> None:
    store = s3_server.store()
    assert store.signs and store.origin == s3_server.endpoint
    address = store.sign_put("a/b", 10, 60)
    assert httpx.put(address, content=b"0123456789").status_code == 200
    ranged = httpx.get(store.sign_get("a/b", 60), headers={"Range": "bytes=2-4"})
    assert (ranged.status_code, ranged.content) == (206, b"234")


def test_an_address_is_signed_with_the_length_and_else_as_obstore_does(s3_server: S3Server) -> None:
    store = s3_server.store()
    plain = store._sign("PUT", "a b/c~d", 60)
    again = signed(plain, {}, "apexcal", "secret")
    assert dict(parse_qsl(urlsplit(again).query)) == dict(parse_qsl(urlsplit(plain).query))
    assert again.partition("?")[0] == plain.partition("?")[0]
    sized = {size: dict(parse_qsl(urlsplit(store.sign_put("a b/c~d", size, 60)).query)) for size in (1, 2)}
    assert {members["X-Amz-SignedHeaders"] for members in sized.values()} == {"content-length;host"}
    assert sized[1]["X-Amz-Signature"] != sized[2]["X-Amz-Signature"]
    assert signed(plain, {"content-length": "1"}, "of-a-role", "unknown") == plain


def test_presigned_addresses_lead_where_clients_find_the_server(s3_server: S3Server) -> None:
    store = s3_server.store(public_endpoint="https://blobs.example.org:8443")
    assert store.origin == "https://blobs.example.org:8443"
    assert store.sign_get("a/b", 60).startswith("https://blobs.example.org:8443/bucket-")
    store.put_bytes("a/b", b"x")
    assert store.get_range("a/b", 0, 1) == b"x"


def test_a_folder_signs_nothing(tmp_path: Path) -> None:
    store = Store(tmp_path.as_uri())
    assert not store.signs and store.origin == ""
    with pytest.raises(ValueError, match="signs"):
        store.sign_put("a", 1, 1)


def test_a_store_that_is_away_is_no_missing_blob(s3_server: S3Server) -> None:
    nobody = Store("s3://b", s3_server.options(endpoint=f"http://127.0.0.1:{free_port()}", timeout_s=0.5))
    no_bucket = Store("s3://there-is-none", s3_server.options())
    for store in (nobody, no_bucket):
        with pytest.raises(StoreUnavailableError):
            store.put_bytes("a", b"x")
        with pytest.raises(StoreUnavailableError):
            store.get_range("a", 0, 1)
        with pytest.raises(StoreUnavailableError):
            list(store.list())


def test_a_store_that_hangs_is_waited_for_so_long(s3_server: S3Server) -> None:
    bucket = f"s3://{s3_server.make_bucket()}"
    patient, store = Store(bucket, s3_server.options()), Store(bucket, s3_server.options(timeout_s=0.5))
    patient.put_bytes("a", b"x")
    s3_server.pause()
    try:
        for look in (lambda: store.get_range("a", 0, 1), lambda: store.put_bytes("b", b"x")):
            began = time.monotonic()
            with pytest.raises(StoreUnavailableError) as found:
                look()
            # An idle machine takes twice half a second and a pause; with the settings' own patience it is twice 20 s.
            assert time.monotonic() - began < 15
            assert isinstance(found.value, OSError)
    finally:
        s3_server.resume()
    assert patient.get_range("a", 0, 1) == b"x"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of one MiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting a small file system takes root")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_said_and_keeps_nothing_half(small_disk: Path, tmp_path: Path) -> None:
    store = folder_store(small_disk)
    store.put_bytes("kept", b"x" * 1000)
    source = tmp_path / "large"
    source.write_bytes(LARGE)
    writes = (
        lambda: store.put_bytes("large", LARGE),
        lambda: store.put_file("large", source),
        lambda: asyncio.run(store.put_stream("large", chunks(LARGE))),
    )
    for write in writes:
        with pytest.raises(StoreFullError):
            write()
        assert [one.key for one in store.list()] == ["kept"]
    store.put_bytes("after", b"y" * 1000)


def test_a_disk_that_is_unmounted_is_no_store_without_objects(small_disk: Path, caplog) -> None:
    store = folder_store(small_disk)
    store.put_bytes("kept", b"12345")
    subprocess.run(["umount", str(small_disk)], check=True)
    source = small_disk.parent / "source"
    source.write_bytes(b"x")
    asked = (
        lambda: store.get_range("kept", 0, 1),
        lambda: list(store.stream("kept")),
        lambda: asyncio.run(store.size("kept")),
        lambda: asyncio.run(store.copy("kept", "copy")),
        lambda: store.put_bytes("new", b"x"),
        lambda: store.put_file("new", source),
        lambda: asyncio.run(store.put_stream("new", chunks(b"x"))),
        lambda: store.delete("kept"),
        lambda: list(store.list()),
    )
    for ask in asked:
        with pytest.raises(StoreUnavailableError):
            ask()
    assert list(small_disk.iterdir()) == [] and "is its disk mounted?" in caplog.text
    subprocess.run(["mount", "-t", "tmpfs", "tmpfs", str(small_disk)], check=True)  # for the fixture to unmount


def test_a_disk_that_goes_during_a_write_or_a_listing_is_noticed(tmp_path: Path, monkeypatch) -> None:
    store = folder_store(tmp_path / "blobs")
    store.put_bytes("kept", b"12345")
    marker = tmp_path / "blobs" / MARKER
    fsync = os.fsync
    monkeypatch.setattr(os, "fsync", lambda file: (marker.unlink(missing_ok=True), fsync(file)))
    with pytest.raises(StoreUnavailableError):
        store.put_bytes("new", b"x")
    store.prepare()
    listing = store.list()
    next(listing)
    marker.unlink()
    with pytest.raises(StoreUnavailableError):
        list(listing)


def test_a_bucket_is_made_once(s3_server: S3Server) -> None:
    url, options = "s3://made-by-preparing/prefix", s3_server.options()
    assert prepare(url, options)
    assert not prepare(url, options)
    assert list(Store(url, options).list()) == []
    with pytest.raises(StoreUnavailableError):
        prepare(url, s3_server.options(endpoint=f"http://127.0.0.1:{free_port()}", timeout_s=0.5))


@pytest.mark.parametrize("url", ["s3:///prefix", "gs://bucket", "blobs", "file://"])
def test_a_strange_address_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="s3://bucket/prefix"):
        Store(url)


def test_settings_come_from_our_variables_or_from_those_of_s3(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://aws")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "a")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "s")
    assert Settings().s3 == S3Options(endpoint="http://aws", access_key_id="a", secret_access_key="s")
    monkeypatch.setenv("APEXCAL_S3_ENDPOINT", "http://ours")
    monkeypatch.setenv("APEXCAL_S3_REGION", "moon")
    assert (Settings().s3.endpoint, Settings().s3.region) == ("http://ours", "moon")
    assert repr(Settings().s3_secret_access_key) == "SecretStr('**********')"
