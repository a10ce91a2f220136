"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from scaling_service.core.threads import use_one_thread

use_one_thread()  # numpy is not imported yet

# Tests start the program some hundred times: a quarter of that is compiling, where nothing of it is kept.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real recordings: ``SCALING_SERVICE_DATA``, else ``../shared/data``."""
    named = os.environ.get("SCALING_SERVICE_DATA")
    folder = Path(named) if named else Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set SCALING_SERVICE_DATA")
    return folder
