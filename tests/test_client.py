"""The Python client against a service: what it sends, and what it makes of answers and of failures."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from scaling_service.client import Client, JobEnded, ServiceRefused
from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import State
from tests.service.http.conftest import tiny
from tests.service.http.served import Served, serving, settings_in
from tests.service.http.test_subjects import person
from tests.service.jobs.services import running
from tests.service.jobs.tiny import TINY

__all__ = ["tiny"]


@pytest.mark.parametrize("name", ["S01.json", "S01.yaml"])
def test_from_a_subject_file_to_files_on_disk(tmp_path: Path, name: str) -> None:
    (tmp_path / "walk.trc").write_text("one")
    (tmp_path / "standing.trc").write_text("two")
    document = person("S01")
    text = json.dumps(document) if name.endswith("json") else yaml.safe_dump(document)
    (tmp_path / name).write_text(text)
    with serving(settings_in(tmp_path), TINY) as served, served.client() as client, running(served.service):
        subject = client.put_subject_file(tmp_path / name)
        assert [file.name for file in subject.files] == ["standing.trc", "walk.trc"]
        job = client.wait(client.ask("tiny", number=5, subject="S01", files=["walk.trc"]), 30.0)
        assert client.result(job)["read"]["walk.trc"] == "one"
        assert [path.read_text() for path in client.download(job, tmp_path / "out")] == ["25"]
        assert [found.id for found in client.jobs(kind="tiny", subject="S01")] == [job.id]
        client.delete(job)
        client.delete_subject("S01")
        assert list(client.jobs()) == list(client.subjects()) == []


def test_lists_longer_than_a_page_are_whole(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path), TINY) as served, served.client() as client:
        asked = [client.ask("tiny", number=k).id for k in range(60)]
        assert [job.id for job in client.jobs()] == asked[::-1]


def test_refusals_and_failures_keep_problem_field_and_remedy(tiny: Served) -> None:
    with tiny.client() as client, running(tiny.service):
        with pytest.raises(ServiceRefused, match="there is no subject 'S99'") as refused:
            client.subject("S99")
        assert (refused.value.status, refused.value.field) == (404, "subject")
        with pytest.raises(JobEnded, match="no marker 'RASIS'") as failed:
            client.wait(client.ask("tiny", fails=True), 30.0)
        assert failed.value.field == "markers.RASIS"
        assert failed.value.remedy


def test_cancelling_and_waiting_for_something_long(tiny: Served) -> None:
    with tiny.client() as client, running(tiny.service):
        job = client.ask("tiny", seconds=60)
        with pytest.raises(TimeoutError):
            client.wait(job, 0.3)
        with pytest.raises(InputError, match="not over"):
            client.delete(job)
        client.cancel(job)
        with pytest.raises(JobEnded, match="cancelled"):
            client.wait(job, 30.0)
        assert client.job(job).state is client.cancel(job).state is State.CANCELLED


def test_a_service_that_is_busy_is_asked_again(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, request_rate=4.0, request_burst=1), TINY) as served:
        with Client(served.url, patience_s=20.0) as patient:
            assert [patient.ask("tiny", number=k).state for k in range(3)] == [State.QUEUED] * 3
        with served.client() as hasty, pytest.raises(ServiceRefused, match="faster than is allowed"):
            _ = [hasty.ask("tiny", number=number) for number in range(9)]


def test_a_service_that_is_away(tmp_path: Path) -> None:
    with (
        Client("http://127.0.0.1:9", patience_s=0.1) as client,
        pytest.raises(InputError, match="not answer"),
    ):
        client.job("0" * 64)


def test_files_outside_the_folder_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(settings_in(tmp_path), TINY) as served, served.client() as client:
        job = client.ask("tiny")
        entry = client.files(job)
        assert entry == []
        monkeypatch.setattr(client, "files", lambda _job: [_Evil()])
        with pytest.raises(InputError, match="outside"):
            client.download(job, tmp_path / "out")


class _Evil:
    name = "../../etc/passwd"


def test_names_and_labels_of_the_laboratory(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path), TINY) as served, served.client() as client:
        assert client.vocabulary().models[0].name == "lower_limb_14dof"
        assert client.marker_map() == {}
        client.put_marker_map({"KNIE r": "RLFE"})
        assert client.marker_map() == {"KNIE r": "RLFE"}
