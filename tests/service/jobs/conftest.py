"""Fixtures of the runner's tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.service.jobs.settings import ServiceSettings
from tests.service.store.fixtures import database_url, sqlite_store, store

__all__ = ["database_url", "sqlite_store", "store"]


@pytest.fixture
def settings(tmp_path: Path, database_url: str | None) -> ServiceSettings:
    """Of a small service, whose leases are short."""
    return ServiceSettings(
        data_directory=tmp_path / "data", database_url=database_url, workers=2, lease_s=3.0, reserve_mb=0
    )
