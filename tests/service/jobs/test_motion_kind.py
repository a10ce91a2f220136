"""Following recordings over the service: what can be asked for, and the numbers of the command line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from scaling_service.capabilities.motion.job import MotionRequest
from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.motion.run import ik
from scaling_service.capabilities.motion.saving import save_motions
from scaling_service.capabilities.scaling.run import scale
from scaling_service.capabilities.scaling.saving import save
from scaling_service.core.errors import InputError
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from tests.jobs.laboratory import document, laboratory
from tests.service.jobs.services import running
from tests.service.jobs.test_kinds import done, put, untimed


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    settings = ServiceSettings(data_directory=tmp_path / "data", workers=1, lease_s=20.0, reserve_mb=0)
    made = Service.open(settings)
    yield made
    made.close()


def test_the_body_has_all_options_of_the_command() -> None:
    asked = MotionRequest.model_validate({"subject": "S01", "poses": True, "smooth_hz": 0.0, "up": "+z"})
    assert asked.part(MotionOptions) == MotionOptions(poses=True, smooth_hz=0.0, up="+z")
    assert KINDS["motion"].route == "motions"
    documents = {"S01": document()}
    assert asked.list_needed(documents)["S01"] == {"recordings.0": "hips.trc", "recordings.1": "walk.trc"}
    with pytest.raises(InputError, match="same name without suffix"):
        MotionRequest(subject="S01", recordings=["walk.trc", "walk.c3d"]).list_needed(documents)
    with pytest.raises(InputError, match="cannot be the name"):
        MotionRequest(subject="S01", model="../model.json").list_needed(documents)


def test_an_uploaded_model_follows_the_subjects_recordings(service: Service, tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    lab.mkdir()
    save(scale(laboratory(lab), "MB_am"), tmp_path / "scaled")
    (lab / "mine.json").write_bytes((tmp_path / "scaled/MB_am/model.json").read_bytes())
    # The label of a marker that only the static trial shows is no fault.
    content = document(markers={"RMFE": "S01:RMKN"})
    put(service, content, lab, "standing.trc", "hips.trc", "walk.trc", "mine.json")
    request = {"subject": "S01", "model": "mine.json", "recordings": ["walk.trc"], "poses": True}
    job = service.ask("lab", "motion", request)[0].id
    with running(service):
        over_service = done(service, job)
    tracked = ik(lab / "mine.json", [lab / "walk.trc"], MotionOptions(poses=True), subject="S01")
    there = save_motions(tracked, tmp_path / "out").model_dump(mode="json")
    assert untimed(over_service) == untimed(there)
    assert {"walk.trc", "mine.json"} <= over_service["input_hashes"].keys()
    _, path = service.file("lab", job, "walk_ik_sd.mot")
    assert path.read_bytes() == (tmp_path / "out/walk_ik_sd.mot").read_bytes()
    again, new = service.ask("lab", "motion", request)
    assert (again.id, again.state.value, new) == (job, "done", False)
    names = json.loads(service.specification("lab", job))["inputs"]
    assert set(names) == {"S01/walk.trc", "S01/mine.json"}
