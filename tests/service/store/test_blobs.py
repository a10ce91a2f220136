"""Files on disk: whole or not there, whoever is killed when."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from scaling_service.service.store import blobs, subjects
from scaling_service.service.store.blobs import Blobs, Content, prepare
from scaling_service.service.store.errors import ContentMissing, TooLarge
from scaling_service.service.store.store import Store
from tests.service.store.fixtures import upload


def files_below(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


def test_content_is_named_by_its_digest_and_kept_once(store: Store) -> None:
    for name in ("S01", "S02"):
        subjects.put(store.database, "lab", name, "{}")
        row = upload(store, "lab", name, "walk.trc", b"the same")
        assert row.sha256 == hashlib.sha256(b"the same").hexdigest()
    assert [path.read_bytes() for path in files_below(store.blobs.folder / "blobs")] == [b"the same"]
    assert files_below(store.blobs.uploads) == []


def test_an_upload_that_is_too_large_or_broken_off_leaves_nothing(sqlite_store: Store) -> None:
    with sqlite_store.incoming(10) as incoming, pytest.raises(TooLarge, match="larger than"):
        incoming.write(b"x" * 11)
    with sqlite_store.incoming(10) as incoming:
        incoming.write(b"x")
    assert files_below(sqlite_store.blobs.uploads) == []


UPLOADING = """
import sys, time
from pathlib import Path
from scaling_service.service.store.blobs import Blobs
with Blobs(Path(sys.argv[1])).incoming(100) as incoming:
    incoming.write(b"half")
    print("writing", flush=True)
    time.sleep(60)
"""


def test_uploads_of_the_dead_are_removed_and_of_the_living_kept(tmp_path: Path) -> None:
    blobs = Blobs(tmp_path)
    with (
        subprocess.Popen(
            [sys.executable, "-c", UPLOADING, str(tmp_path)], stdout=subprocess.PIPE, text=True
        ) as process,
        blobs.incoming(100),
    ):
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        assert blobs.remove_dead_uploads() == 0
        process.kill()
        process.wait()
        assert blobs.remove_dead_uploads() == 1
        assert len(files_below(blobs.uploads)) == 1


def test_a_file_that_a_failed_transaction_left_is_collected(store: Store) -> None:
    with store.incoming(100) as incoming:
        incoming.write(b"orphan")
        content = incoming.finish()
        with store.write() as connection:
            blobs.keep(connection, store.blobs, [content])
            connection.rollback()  # as if killed after the rename
    assert store.blobs.path(content.sha256).exists()
    store.tidy()
    assert not store.blobs.path(content.sha256).exists()


def test_collecting_may_be_cut_short_after_the_file_is_gone(store: Store) -> None:
    """The row says that the content is there; the next upload of it puts it back."""
    subjects.put(store.database, "lab", "S01", "{}")
    row = upload(store, "lab", "S01", "a", b"content")
    subjects.detach(store.database, store.blobs, "lab", "S01", "a")
    with store.write() as connection:
        blobs._lock(connection, row.sha256, {"size": row.size})  # as if the collector's commit never came
    upload(store, "lab", "S01", "a", b"content")
    store.tidy()
    assert store.blobs.path(row.sha256).read_bytes() == b"content"


def test_placing_again_after_a_failed_commit_is_harmless(tmp_path: Path) -> None:
    blobs = Blobs(tmp_path / "data")
    file = tmp_path / "data" / "scratch" / "made"
    file.write_bytes(b"made")
    content = prepare(file)
    blobs.place(content)
    blobs.place(content)
    assert blobs.path(content.sha256).read_bytes() == b"made"
    with pytest.raises(ContentMissing):
        blobs.place(Content("0" * 64, 1, tmp_path / "nothing"))


def test_damage_on_disk_is_found_when_content_is_used(sqlite_store: Store, tmp_path: Path) -> None:
    subjects.put(sqlite_store.database, "lab", "S01", "{}")
    row = upload(sqlite_store, "lab", "S01", "a", b"content")
    sqlite_store.blobs.copy(row.sha256, tmp_path / "good")
    sqlite_store.blobs.path(row.sha256).write_bytes(b"c0ntent")
    with pytest.raises(ContentMissing, match="damaged"):
        sqlite_store.blobs.copy(row.sha256, tmp_path / "bad")


def test_nothing_that_is_referred_to_is_collected_beside_writers(store: Store) -> None:
    """Writers attach and remove the same few contents while a collector removes what is unused."""
    names = [f"S{k}" for k in range(3)]
    for name in names:
        subjects.put(store.database, "lab", name, "{}")
    over, troubles = threading.Event(), list[BaseException]()

    def write(name: str) -> None:
        try:
            for k in range(25):
                row = upload(store, "lab", name, "a", str(k % 3).encode())
                assert store.blobs.path(row.sha256).read_bytes() == str(k % 3).encode()
                if k % 2:
                    subjects.detach(store.database, store.blobs, "lab", name, "a")
        except BaseException as error:  # noqa: BLE001 (told below, in the main thread)
            troubles.append(error)

    def collect_garbage() -> None:
        while not over.is_set():
            blobs.collect_garbage(store.database, store.blobs)

    threads = [threading.Thread(target=write, args=(name,)) for name in names]
    collector = threading.Thread(target=collect_garbage)
    for thread in (collector, *threads):
        thread.start()
    for thread in threads:
        thread.join()
    over.set()
    collector.join()
    assert troubles == []
    for name in names:
        for file in subjects.list_files(store.database, "lab", name):
            assert hashlib.sha256(store.blobs.path(file.sha256).read_bytes()).hexdigest() == file.sha256
