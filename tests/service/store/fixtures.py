"""Stores on both databases."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from scaling_service.service.store import subjects
from scaling_service.service.store.store import Store
from scaling_service.service.store.tables import FileRow
from tests.service.store.postgres import server


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest) -> str | None:
    """None for SQLite in the data directory."""
    return None if request.param == "sqlite" else server().new_database()


@pytest.fixture
def store(tmp_path: Path, database_url: str | None) -> Iterator[Store]:
    """An empty store, on either database."""
    made = Store.open(tmp_path / "data", database_url)
    yield made
    made.close()


@pytest.fixture
def sqlite_store(tmp_path: Path) -> Iterator[Store]:
    """An empty store on SQLite."""
    made = Store.open(tmp_path / "data")
    yield made
    made.close()


def upload(store: Store, owner: str, subject: str, name: str, content: bytes) -> FileRow:
    """Keep bytes as a subject's file."""
    with store.incoming(1 << 30) as incoming:
        incoming.write(content)
        return subjects.attach(
            store.database, store.blobs, owner, subject, name, incoming.finish(), most=1000
        )
