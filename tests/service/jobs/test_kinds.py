"""Every kind gives over the service what the same function gives on the command line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import trimesh

from scaling_service.capabilities.landmarks.run import landmark_bones
from scaling_service.documents.base import DOCUMENT
from scaling_service.documents.jobs import State
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from tests.bones.bones import femur
from tests.jobs.laboratory import document, laboratory
from tests.service.jobs.services import ended, running


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    settings = ServiceSettings(data_directory=tmp_path / "data", workers=1, lease_s=20.0, reserve_mb=0)
    made = Service.open(settings)
    yield made
    made.close()


def put(service: Service, content: dict[str, Any], folder: Path, *names: str) -> None:
    service.put_subject("lab", content)
    for name in names:
        with service.upload("lab", content["subject"]["id"], name) as upload:
            upload.write((folder / name).read_bytes())
            upload.keep()


def untimed(value: Any) -> Any:
    """A document without what differs from run to run, and from file name to file name."""
    if isinstance(value, dict):
        left_out = ("wall_s", "input_hashes")
        return {key: untimed(inner) for key, inner in value.items() if key not in left_out}
    return [untimed(inner) for inner in value] if isinstance(value, list) else value


def done(service: Service, job: str) -> dict[str, Any]:
    row = ended(service, "lab", job, within_s=120.0)
    assert row.state is State.DONE, row.failure
    result: dict[str, Any] = json.loads(service.result("lab", job) or "")
    return result


def test_landmarks_are_those_of_the_command_line(service: Service, tmp_path: Path) -> None:
    trimesh.Trimesh(*femur(), process=False).export(tmp_path / "femur_r.stl")
    put(service, {"subject": {"id": "S01"}}, tmp_path, "femur_r.stl")
    asked = {"subject": "S01", "units": "mm", "bones": {"femur_r": "femur_r.stl"}}
    job = service.ask("lab", "landmarks", asked)[0].id
    with running(service):
        over_service = done(service, job)
    there = landmark_bones({"femur_r": tmp_path / "femur_r.stl"}, units="mm").model_dump(mode="json")
    assert over_service["femur_r"] == there["femur_r"]
    assert over_service["femur_r"]["head_radius_mm"] == pytest.approx(24.0, abs=0.05)  # as it was made
    assert [row.name for row in service.files("lab", job)] == ["landmarks.json"]


@pytest.mark.parametrize("kind", ["linear-scaling", "landmarks"])
def test_what_was_written_is_not_read_back(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs, outputs = tmp_path / "in", tmp_path / "out"
    (inputs / "S01").mkdir(parents=True)
    outputs.mkdir()
    laboratory(inputs / "S01")
    (inputs / "S01" / DOCUMENT).write_text(json.dumps(document()), encoding="utf-8")
    trimesh.Trimesh(*femur(), process=False).export(inputs / "S01" / "femur_r.stl")
    read = Path.read_text

    def read_input(file: Path, *options: Any, **more: Any) -> str:
        assert outputs not in file.parents
        return read(file, *options, **more)

    bones = {"units": "mm", "bones": {"femur_r": "femur_r.stl"}} if kind == "landmarks" else {}
    with monkeypatch.context() as patched:
        patched.setattr(Path, "read_text", read_input)
        request = KINDS[kind].request.model_validate({"subject": "S01"} | bones)
        result = KINDS[kind].work(request, inputs, outputs, lambda *_: None)
    (file,) = outputs.glob("landmarks.json" if bones else "MB/scaling.json")
    assert json.loads(file.read_text(encoding="utf-8")) == json.loads(json.dumps(result))


def test_a_recording_that_is_damaged_fails_its_own_job_only(service: Service, tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    lab.mkdir()
    laboratory(lab)
    (lab / "bomb.c3d").write_bytes(b"\x02\x50" + b"\xff" * 4096)
    put(service, document(), lab, "standing.trc", "hips.trc", "walk.trc", "bomb.c3d")
    good = service.ask("lab", "scaling", {"subject": "S01", "methods": ["MB"]})[0].id
    service.put_subject("lab", document(trials={"static": "standing.trc", "evaluation": ["bomb.c3d"]}))
    bad = service.ask("lab", "scaling", {"subject": "S01", "methods": ["MB"]})[0].id
    with running(service):
        row = ended(service, "lab", bad, within_s=60.0)
        done(service, good)
    assert row.failure is not None
    assert row.failure.file == "S01/bomb.c3d"
    assert row.failure.remedy
