"""What is asked for is checked before anything is queued."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.documents.base import require_plain_name
from scaling_service.documents.jobs import State
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.jobs.submission import RequestInvalid
from scaling_service.service.store import keys
from scaling_service.service.store.errors import NotFound, TooLarge
from tests.jobs.laboratory import document


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    made = Service.open(ServiceSettings(data_directory=tmp_path / "data", limit_upload_mb=1))
    yield made
    made.close()


def upload(service: Service, *names: str) -> None:
    for name in names:
        with service.upload("lab", "S01", name) as incoming:
            incoming.write(name.encode())
            incoming.keep()


def test_a_file_that_is_not_there_is_named_with_its_field(service: Service) -> None:
    service.put_subject("lab", document())
    upload(service, "standing.trc", "hip.trc")
    with pytest.raises(SubjectInvalid, match=r"'hips\.trc' was not uploaded") as caught:
        service.ask("lab", "scaling", {"subject": "S01"})
    assert caught.value.field == "trials.calibration.0"
    assert caught.value.remedy == "Did you mean 'hip.trc'?"
    assert service.jobs("lab").items == ()


def test_the_names_of_its_labels_go_with_a_label_map(service: Service) -> None:
    service.put_subject("lab", document(bones={"segmentation": "leg.nii.gz"}))
    upload(service, "standing.trc", "hips.trc", "walk.trc", "leg.nii.gz", "leg.json", "other.json")
    job, _ = service.ask("lab", "scaling", {"subject": "S01"})
    given = json.loads(service.specification("lab", job.id))["inputs"]
    assert {"S01/leg.nii.gz", "S01/leg.json"} <= given.keys()
    assert "S01/other.json" not in given


def test_only_the_files_that_are_named_count(service: Service) -> None:
    service.put_subject("lab", document())
    upload(service, "standing.trc", "hips.trc", "walk.trc")
    first, queued = service.ask("lab", "scaling", {"subject": "S01"})
    upload(service, "notes.txt")
    again, queued_again = service.ask("lab", "scaling", {"subject": "S01"})
    assert (first.id, queued, queued_again) == (again.id, True, False)
    assert first.state is State.QUEUED
    service.put_subject("lab", document(subject={"id": "S01", "mass_kg": 70.0}))
    assert service.ask("lab", "scaling", {"subject": "S01"})[0].id != first.id


@pytest.mark.parametrize(
    ("request_", "field"),
    [
        ({}, "subject"),
        ({"subject": "../S01"}, "subject"),
        ({"subject": "S01", "methods": ["XX"]}, "methods"),
        ({"subject": "S01", "methods": []}, "methods"),
        ({"subject": "S01", "methods": ["MB", "MB"]}, "methods"),
        ({"subject": "S01", "settings": {"calibration": {"n_frames": 0}}}, "settings.calibration.n_frames"),
        ({"subject": "S01", "settings": {"processing": {"cutoff_hz": -1}}}, "settings.processing.cutoff_hz"),
        ({"subject": "S01", "settings": {"calibration": {"unknown": 1}}}, "settings.calibration.unknown"),
        ({"subject": "S01", "other": 1}, "other"),
    ],
)
def test_wrong_requests_are_refused(service: Service, request_: dict[str, Any], field: str) -> None:
    service.put_subject("lab", document())
    with pytest.raises(RequestInvalid) as caught:
        service.ask("lab", "scaling", request_)
    assert caught.value.field == field


@pytest.mark.parametrize(
    "name",
    ["../a", "a/b", "/etc/passwd", "", ".", "..", ".hidden", "a\x00b", "a\nb", "~root", "subject.json"],
)
def test_names_of_files_are_plain(service: Service, name: str) -> None:
    with pytest.raises(InputError):
        require_plain_name(name)
    service.put_subject("lab", document(trials={"static": name or "x/y"}))
    with pytest.raises(InputError):
        service.ask("lab", "scaling", {"subject": "S01"})
    with pytest.raises(InputError), service.upload("lab", "S01", name):
        pass


def test_usual_names_are_taken() -> None:
    for name in ("Walking01.c3d", "S01 marche (2).trc", "Größe.osim", "a" * 200):
        assert require_plain_name(name) == name


def test_a_subject_of_images_only_can_have_landmarks_but_no_model(service: Service) -> None:
    service.put_subject("lab", {"subject": {"id": "S01"}, "bones": {"units": "mm", "femur_r": "f.stl"}})
    with pytest.raises(SubjectInvalid, match="not uploaded"):
        service.ask("lab", "landmarks", {"subject": "S01"})
    upload(service, "f.stl")
    assert service.ask("lab", "landmarks", {"subject": "S01"})[1]
    with pytest.raises(SubjectInvalid, match="missing"):
        service.ask("lab", "scaling", {"subject": "S01"})
    with pytest.raises(SubjectInvalid, match="unknown key"):
        service.put_subject("lab", {"subject": {"id": "S01"}, "bone": {}})


def test_uploads_have_a_limit_and_need_a_subject(service: Service) -> None:
    with pytest.raises(NotFound), service.upload("lab", "S01", "a.trc"):
        pass
    service.put_subject("lab", document())
    with service.upload("lab", "S01", "a.trc") as incoming, pytest.raises(TooLarge):
        incoming.write(b"x" * 1_000_001)
    assert service.subject_files("lab", "S01") == []


def test_nothing_of_another_owner_can_be_seen_or_done(service: Service) -> None:
    service.put_subject("lab", document())
    upload(service, "standing.trc", "hips.trc", "walk.trc")
    job = service.ask("lab", "scaling", {"subject": "S01"})[0].id
    for call in (
        lambda: service.subject("other", "S01"),
        lambda: service.subject_document("other", "S01"),
        lambda: service.subject_files("other", "S01"),
        lambda: service.subject_file("other", "S01", "walk.trc"),
        lambda: service.remove_subject_file("other", "S01", "walk.trc"),
        lambda: service.delete_subject("other", "S01"),
        lambda: service.ask("other", "scaling", {"subject": "S01"}),
        lambda: service.job("other", job),
        lambda: service.specification("other", job),
        lambda: service.result("other", job),
        lambda: service.provenance("other", job),
        lambda: service.files("other", job),
        lambda: service.file("other", job, "comparison.json"),
        lambda: service.cancel("other", job),
        lambda: service.delete_job("other", job),
    ):
        with pytest.raises(NotFound):
            call()
    assert service.subjects("other").items == service.jobs("other").items == ()
    assert service.job("lab", job).state is State.QUEUED
    assert len(service.subject_files("lab", "S01")) == 3


@pytest.mark.parametrize("name", ["\x00", "a\x00b", "\ud800", "\n", "x" * 3000, "' OR 1=1 --"])
def test_names_from_outside_that_nothing_can_have_are_not_found(settings: ServiceSettings, name: str) -> None:
    """On either database, and before one sees them."""
    service = Service.open(settings)
    service.put_subject("lab", {"subject": {"id": "S01"}})
    for call in (
        lambda: service.subject("lab", name),
        lambda: service.subject_document("lab", name),
        lambda: service.subject_file("lab", "S01", name),
        lambda: service.remove_subject_file("lab", "S01", name),
        lambda: service.delete_subject("lab", name),
        lambda: service.ask("lab", name, {}),
        lambda: service.job("lab", name),
        lambda: service.result("lab", name),
        lambda: service.file("lab", name, "a"),
        lambda: service.cancel("lab", name),
        lambda: service.delete_job("lab", name),
    ):
        with pytest.raises(NotFound):
            call()
    for cursor in (
        name,
        base64.urlsafe_b64encode(b"1 \x00").decode(),
        base64.urlsafe_b64encode(b"9" * 40).decode(),
    ):
        with pytest.raises(InputError):
            service.jobs("lab", cursor=cursor)
    assert keys.find_owner(service.store.database, f"scs_{name}_{name}") is None
    service.close()


def test_halves_of_characters_are_refused_and_odd_ones_kept(settings: ServiceSettings) -> None:
    service = Service.open(settings)
    content = {"subject": {"id": "S01"}, "model": "lower_limb_14dof", "trials": {"static": "a.trc"}}
    odd = content | {"extra_markers": {"a\x00b é": "femur_r"}}
    service.put_subject("lab", odd)
    assert service.subject_document("lab", "S01") == odd
    with pytest.raises(InputError):
        service.put_subject("lab", content | {"extra_markers": {"\ud800": "femur_r"}})
    with service.upload("lab", "S01", "a.trc") as incoming:
        incoming.keep()
    with pytest.raises(InputError):
        service.ask("lab", "scaling", {"subject": "S01", "settings": {"up": "\ud800"}})
    service.close()


@pytest.mark.parametrize(
    ("kind", "more", "field"),
    [
        ("scaling", {"settings": {"seed": False}}, "settings.seed"),
        ("dynamics", {"cutoff_hz": True}, "cutoff_hz"),
        ("dynamics", {"cutoff_hz": "6"}, "cutoff_hz"),
        ("dynamics", {"identify": 1}, "identify"),
        ("proof", {"labels": {"x": 1}}, "labels.x"),
    ],
)
def test_nothing_is_converted_silently(service: Service, kind: str, more: dict[str, Any], field: str) -> None:
    service.put_subject("lab", document())
    with pytest.raises(RequestInvalid) as caught:
        service.ask("lab", kind, {"subject": "S01", **more})
    assert caught.value.field == field


def test_a_proof_reads_every_file_that_is_there(service: Service) -> None:
    service.put_subject("lab", {"subject": {"id": "S01"}})
    upload(service, "standing.trc", "notes.txt")
    first = service.ask("lab", "proof", {"subject": "S01"})[0]
    reported = json.loads(service.specification("lab", first.id))
    assert set(reported["inputs"]) == {"S01/standing.trc", "S01/notes.txt"}
    assert reported["request"]["labels"] == {}
    upload(service, "walk.trc")
    assert service.ask("lab", "proof", {"subject": "S01"})[0].id != first.id
