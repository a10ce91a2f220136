"""The tables are those that the program thinks of, however they were made."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import text

from scaling_service.service.store.errors import StoreTooNew
from scaling_service.service.store.jobs import lock_next
from scaling_service.service.store.store import Store, configure
from scaling_service.service.store.tables import metadata


def test_the_tables_are_what_the_program_thinks_of(store: Store) -> None:
    with store.read() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []


def test_many_may_start_at_once(tmp_path: Path, database_url: str | None) -> None:
    opened, troubles = list[Store](), list[BaseException]()

    def open_store() -> None:
        try:
            opened.append(Store.open(tmp_path, database_url))
        except BaseException as error:  # noqa: BLE001 (told below, in the main thread)
            troubles.append(error)

    threads = [threading.Thread(target=open_store) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert troubles == []
    with opened[0].read() as connection:
        assert connection.execute(text("SELECT version_num FROM alembic_version")).all() == [("0005",)]
    for store in opened:
        store.close()


def test_tables_of_a_later_version_are_refused(store: Store, database_url: str | None) -> None:
    with store.write() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(StoreTooNew, match="9999"):
        Store.open(store.blobs.folder, database_url)


def test_jobs_of_the_first_tables_stay(tmp_path: Path, database_url: str | None) -> None:
    store = Store.open(tmp_path, database_url)
    with store.write() as connection:
        command.downgrade(configure(connection), "0001")
        connection.execute(text("INSERT INTO owners (name) VALUES ('lab')"))
        connection.execute(
            text(
                "INSERT INTO jobs (id, owner, kind, state, created_us, updated_us, code_version, "
                "specification) VALUES ('a', 'lab', 'tiny', 'queued', 1, 1, '1', '{}')"
            )
        )
    store.close()
    store = Store.open(tmp_path, database_url)
    with store.write() as connection:
        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
        row = lock_next(connection)
    assert row is not None
    assert row.id == "a"
    store.close()
