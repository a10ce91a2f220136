"""Dynamics over the service: what can be asked for, and the numbers of the command line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from scaling_service.capabilities.dynamics.job import DynamicsRequest
from scaling_service.capabilities.dynamics.run import dynamics
from scaling_service.capabilities.dynamics.saving import save_dynamics
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.shared.names import AS_IT_IS, OWN
from scaling_service.model.inertia import TABLE_NAMES
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from tests.jobs.force_laboratory import document, force_laboratory
from tests.service.jobs.services import running
from tests.service.jobs.test_kinds import done, put, untimed


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    settings = ServiceSettings(data_directory=tmp_path / "data", workers=1, lease_s=20.0, reserve_mb=0)
    made = Service.open(settings)
    yield made
    made.close()


def choices(field: str) -> set[str]:
    return set(DynamicsRequest.model_json_schema()["properties"][field]["anyOf"][0]["enum"])


def test_all_that_the_command_line_takes_can_be_asked_for() -> None:
    assert choices("start") == {*METHODS, AS_IT_IS}
    assert choices("inertia") == {*TABLE_NAMES, OWN}
    asked = DynamicsRequest.model_validate({"subject": "S01", "free_mass": True})
    assert asked.part(DynamicsSettings) == DynamicsSettings(free_mass=True)
    assert asked.settings.processing.smoothing == "none"
    for wrong in ({"start": "MBB"}, {"samples": 20}, {"cutoff_hz": 0.0}):
        with pytest.raises(ValidationError):
            DynamicsRequest.model_validate({"subject": "S01"} | wrong)


def test_numbers_are_those_of_the_command_line(service: Service, tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    lab.mkdir()
    file = force_laboratory(lab)
    put(service, document(), lab, "sway.trc", "swing.trc", "sway_grf.mot", "swing_grf.mot")
    job = service.ask("lab", "dynamics", {"subject": "S01", "start": "none"})[0].id
    with running(service):
        over_service = done(service, job)
    results = dynamics(file, DynamicsSettings(start="none"))
    there = save_dynamics(results, tmp_path / "out").model_dump(mode="json")
    assert untimed(over_service) == untimed(there)
    names = {row.name for row in service.files("lab", job)}
    assert {name for name in names if not name.startswith("scene/")} == {
        path.name for path in (tmp_path / "out").iterdir()
    }
    _, file = service.file("lab", job, "scene/residuals.json")
    for name, trial in json.loads(file.read_text(encoding="utf-8"))["trials"].items():
        _, file = service.file("lab", job, trial["residual"]["file"])
        values = np.fromfile(file, "<f4").reshape(trial["residual"]["shape"]).astype(float)
        reported = list(over_service["trials"][name]["residual_rms"].values())
        assert np.sqrt(np.nanmean(values**2, axis=0)) == pytest.approx(reported, rel=1e-3, abs=1e-3)
