"""A laboratory's folder and what is made of it, once for all tests here."""

from __future__ import annotations

from pathlib import Path

import pytest

from scaling_service.capabilities.scaling.result import Results
from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.recording.settings import ProcessingSettings
from tests.finished import fill_once, make_once
from tests.jobs.laboratory import laboratory

UNSMOOTHED = Settings(processing=ProcessingSettings(smoothing="none"))


@pytest.fixture(scope="session")
def subject_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fill_once(tmp_path_factory, "laboratory", laboratory) / "S01.yaml"


@pytest.fixture(scope="session")
def results(subject_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Results:
    return make_once(tmp_path_factory, "compared", lambda: compare(subject_file, settings=UNSMOOTHED))
