"""A disk that is full or read-only, a database that is gone: a clear word, and no harm."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import text

from scaling_service.service.store import keys, subjects
from scaling_service.service.store.errors import StoreFull, StoreUnavailable
from scaling_service.service.store.store import Store
from tests.service.store.disks import SmallDisk, small_disk
from tests.service.store.fixtures import upload
from tests.service.store.postgres import Server, require


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    with small_disk(tmp_path / "disk", 8) as made:
        yield made


@pytest.fixture
def disk_store(disk: SmallDisk) -> Iterator[Store]:
    made = Store.open(disk.folder / "data")
    subjects.put(made.database, "lab", "S01", "{}")
    upload(made, "lab", "S01", "before", b"before")
    yield made
    made.close()


def sound(store: Store) -> bool:
    """SQLite's own opinion of its file, and ours of the contents."""
    assert store.database.run_apart("PRAGMA integrity_check") == ["ok"]
    rows = subjects.list_files(store.database, "lab", "S01")
    return all(store.blobs.path(row.sha256).stat().st_size == row.size for row in rows)


def fill_database(store: Store) -> None:
    for k in range(1000):
        subjects.put(store.database, "lab", f"S{k}", '"' + 10_000 * "x" + '"')


def names(store: Store) -> list[str]:
    return [row.name for row in subjects.list_files(store.database, "lab", "S01")]


def test_a_full_disk_refuses_and_recovers(disk: SmallDisk, disk_store: Store) -> None:
    disk.fill()
    with pytest.raises(StoreFull, match="no room"):
        upload(disk_store, "lab", "S01", "walk.trc", b"x" * 100_000)
    with pytest.raises(StoreFull, match="no room"):
        fill_database(disk_store)
    with pytest.raises(StoreFull):
        disk_store.require_room(1 << 20)
    assert names(disk_store) == ["before"]  # reading goes on
    disk.empty()
    upload(disk_store, "lab", "S01", "walk.trc", b"x" * 100_000)
    assert names(disk_store) == ["before", "walk.trc"]
    assert sound(disk_store)


def test_a_read_only_disk_refuses_and_recovers(disk: SmallDisk, disk_store: Store) -> None:
    disk_store.database.close()  # no file is open for writing
    disk.make_read_only()
    for attempt in (
        lambda: upload(disk_store, "lab", "S01", "walk.trc", b"x"),
        lambda: keys.create(disk_store.database, "lab"),
        lambda: Store.open(disk.folder / "data"),
    ):
        with pytest.raises(StoreUnavailable):
            attempt()
    disk_store.database.close()
    disk.make_writable()
    upload(disk_store, "lab", "S01", "walk.trc", b"x")
    assert names(disk_store) == ["before", "walk.trc"]
    assert sound(disk_store)


def test_a_data_directory_that_is_gone_is_reported(tmp_path: Path) -> None:
    store = Store.open(tmp_path / "data")
    (tmp_path / "data").rename(tmp_path / "elsewhere")
    with pytest.raises(StoreUnavailable), store.incoming(10):
        pass
    with pytest.raises(StoreUnavailable):
        store.check()
    (tmp_path / "elsewhere").rename(tmp_path / "data")
    store.check()
    store.close()


def test_a_database_that_was_gone_is_used_again(tmp_path: Path) -> None:
    require()
    server = Server()
    try:
        store = Store.open(tmp_path, server.new_database())
        subjects.put(store.database, "lab", "S01", "{}")
        upload(store, "lab", "S01", "before", b"before")
        server.stop()
        for _ in range(3):
            with pytest.raises(StoreUnavailable, match="does not answer"):
                subjects.get(store.database, "lab", "S01")
            with pytest.raises(StoreUnavailable):
                upload(store, "lab", "S01", "during", b"during")
        server.start()
        assert names(store) == ["before"]
        upload(store, "lab", "S01", "after", b"after")
        store.tidy()
        assert names(store) == ["after", "before"]
        assert (
            store.blobs.path(subjects.list_files(store.database, "lab", "S01")[0].sha256).read_bytes()
            == b"after"
        )
        store.close()
    finally:
        server.remove()


def test_an_error_of_a_statement_is_no_outage(store: Store) -> None:
    with pytest.raises(Exception, match="no_such_table") as caught, store.read() as connection:
        connection.execute(text("SELECT * FROM no_such_table"))
    assert not isinstance(caught.value, StoreUnavailable)


def test_a_data_directory_may_have_any_name(tmp_path: Path) -> None:
    folder = tmp_path / "données ?mode=ro&x=%20 #1"
    store = Store.open(folder)
    subjects.put(store.database, "lab", "S01", "{}")
    store.close()
    assert (folder / "store.sqlite").exists()
