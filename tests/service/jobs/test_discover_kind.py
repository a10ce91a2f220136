"""The search over the service: what can be asked for, and the numbers of the command line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from pydantic import ValidationError

from scaling_service.capabilities.discovery.job import DiscoverRequest
from scaling_service.capabilities.discovery.options import DiscoverSettings
from scaling_service.capabilities.discovery.run import discover
from scaling_service.capabilities.discovery.saving import save_discovery
from scaling_service.capabilities.scaling.methods.table import METHODS
from scaling_service.capabilities.shared.names import AS_IT_IS, OWN
from scaling_service.files.trc import write_trc
from scaling_service.model.inertia import TABLE_NAMES
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from tests.jobs.hidden_case import session
from tests.service.jobs.services import running
from tests.service.jobs.test_kinds import done, put, untimed


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    settings = ServiceSettings(data_directory=tmp_path / "data", workers=1, lease_s=20.0, reserve_mb=0)
    made = Service.open(settings)
    yield made
    made.close()


def choices(field: str) -> set[str]:
    return set(DiscoverRequest.model_json_schema()["properties"][field]["anyOf"][0]["enum"])


def test_all_that_the_command_line_takes_can_be_asked_for() -> None:
    assert choices("start") == {*METHODS, AS_IT_IS}
    assert choices("inertia") == {*TABLE_NAMES, OWN}
    asked = DiscoverRequest.model_validate({"subject": "S01", "start": "none", "cutoff_hz": 8.0})
    assert asked.part(DiscoverSettings) == DiscoverSettings(start="none", cutoff_hz=8.0)
    assert asked.settings.processing.smoothing == "none"
    assert not asked.settings.processing.solidify
    for wrong in ({"start": "MBB"}, {"inertia": "mine"}, {"cutoff_hz": 0.0}):
        with pytest.raises(ValidationError):
            DiscoverRequest.model_validate({"subject": "S01"} | wrong)
    assert KINDS["discovery"].route == "discoveries"


def test_numbers_are_those_of_the_command_line(service: Service, tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    lab.mkdir()
    write_trc(lab / "walk.trc", session().evaluation[0].frames(slice(0, 60)))
    document = {
        "subject": {"id": "S01"},
        "model": "lower_limb_14dof",
        "trials": {"evaluation": ["walk.trc"]},
    }
    file = lab / "S01.yaml"
    file.write_text(yaml.safe_dump(document), encoding="utf-8")
    put(service, document, lab, "walk.trc")
    job = service.ask("lab", "discovery", {"subject": "S01", "start": "none"})[0].id
    with running(service):
        over_service = done(service, job)
    results = discover(file, DiscoverSettings(start="none"))
    there = save_discovery(results, tmp_path / "out").model_dump(mode="json")
    assert untimed(over_service) == untimed(there)
    names = {row.name for row in service.files("lab", job)}
    assert "scene/scene.json" in names
    assert {name for name in names if not name.startswith("scene/")} == {
        path.relative_to(tmp_path / "out").as_posix()
        for path in (tmp_path / "out").rglob("*")
        if path.is_file()
    }
