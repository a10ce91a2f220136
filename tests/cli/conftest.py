"""A sound laboratory, once, and a copy of it for each test to spoil."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.cli.spoilt import PERSON
from tests.jobs.laboratory import laboratory


@pytest.fixture(scope="session")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sound")
    laboratory(folder, PERSON)
    return folder


@pytest.fixture
def folder(sound: Path, tmp_path: Path) -> Path:
    """A laboratory's folder of its own, to be spoilt."""
    return Path(shutil.copytree(sound, tmp_path / "laboratory"))
