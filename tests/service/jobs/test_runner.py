"""From asking to a result that is kept."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator

import pytest

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store.errors import NotFound
from tests.service.jobs.services import all_done, ended, running, tiny_service, until


@pytest.fixture
def service(settings: ServiceSettings) -> Iterator[Service]:
    with tiny_service(settings) as made:
        yield made


def ask(service: Service, owner: str = "lab", **request: object) -> str:
    return service.ask(owner, "tiny", request)[0].id


def uploaded(service: Service, owner: str = "lab", content: bytes = b"steps") -> None:
    service.put_subject(owner, {"subject": {"id": "S01"}})
    with service.upload(owner, "S01", "walk.txt") as upload:
        upload.write(content)
        upload.keep()


def test_a_job_ends_with_result_files_and_provenance(service: Service) -> None:
    uploaded(service)
    job = ask(service, number=7, subject="S01", files=["walk.txt"])
    with running(service):
        row = ended(service, "lab", job)
    assert (row.state, row.attempt, row.losses, row.progress_share) == (State.DONE, 1, 0, 1.0)
    result = json.loads(service.result("lab", job) or "")
    assert result["square"] == 49
    assert result["read"]["walk.txt"] == "steps"
    file, path = service.file("lab", job, "square.txt")
    assert (file.size, path.read_text()) == (2, "49")
    origin = json.loads(service.provenance("lab", job) or "")
    (digest,) = origin["input_hashes"].values()
    # printf steps | sha256sum
    assert digest == "b7595e2a863957fc6c225ed540d335dd1e859dd3032451c2e11bceb0329defa6"
    assert origin["code_version"] == row.code_version
    assert origin["attempts"] == 1
    assert origin["host"] == socket.gethostname()
    assert list(service.store.blobs.work.iterdir()) == []


def test_the_same_request_is_computed_once_and_its_answer_is_there_at_once(service: Service) -> None:
    job = ask(service, number=3)
    with running(service):
        ended(service, "lab", job)
    again, queued = service.ask("lab", "tiny", {"number": 3, "seconds": 0.0})
    assert (again.id, queued, again.state) == (job, False, State.DONE)
    assert ask(service, number=4) != job
    assert ask(service, "other", number=3) != job


def test_a_replaced_file_makes_another_job_and_the_first_keeps_its_own(service: Service) -> None:
    uploaded(service, content=b"first")
    request = {"number": 1, "subject": "S01", "files": ["walk.txt"]}
    first = ask(service, **request)
    uploaded(service, content=b"second")
    service.store.tidy()
    second = ask(service, **request)
    with running(service):
        for job, content in ((first, "first"), (second, "second")):
            assert ended(service, "lab", job).state is State.DONE
            assert json.loads(service.result("lab", job) or "")["read"]["walk.txt"] == content


def test_a_failure_is_reported_in_the_words_of_the_command_line(service: Service) -> None:
    job = ask(service, fails=True)
    with running(service):
        row = ended(service, "lab", job)
    assert row.state is State.FAILED
    assert row.failure is not None
    assert row.failure.kind == "MarkerMissing"
    assert row.failure.remedy is not None
    assert service.result("lab", job) is None


def test_what_is_brief_waits_for_no_worker_and_takes_no_long_jobs_place(service: Service) -> None:
    """Of five workers' worth of long jobs, two run: as many as there are workers."""
    long = [ask(service, number=k, seconds=20.0) for k in range(5)]
    with running(service):
        until(lambda: service.counts()[State.RUNNING] == 2)
        for number in range(3):
            brief = service.ask("lab", "brief", {"number": number})[0].id
            assert ended(service, "lab", brief, within_s=10.0).state is State.DONE
        states = [service.job("lab", job).state for job in long]
    assert states.count(State.RUNNING) == 2
    assert states.count(State.QUEUED) == 3


def test_nobody_waits_for_what_others_have_looked_at(service: Service) -> None:
    """However many checks of one owner wait, another's is next: each has a slot of its own."""
    heavy = [service.ask("lab", "brief", {"number": k, "seconds": 20.0})[0].id for k in range(6)]
    with running(service):
        until(lambda: service.counts()[State.RUNNING] == 3)  # two workers, and the slot
        small = service.ask("other", "brief", {"number": 9})[0].id
        assert ended(service, "other", small, within_s=5.0).state is State.DONE
        states = [service.job("lab", job).state for job in heavy]
    assert states.count(State.QUEUED) == 3


def test_a_check_has_a_limit_of_processor_time_of_its_own(settings: ServiceSettings) -> None:
    chosen = settings.model_copy(update={"limit_check_cpu_s": 1.0})
    with tiny_service(chosen) as service, running(service):
        job = service.ask("lab", "brief", {"spins": True})[0].id
        failure = ended(service, "lab", job, within_s=20.0).failure
        assert failure is not None
        assert (failure.kind, failure.field) == ("LimitExceeded", "limit_check_cpu_s")


def test_progress_is_seen_and_cancelling_takes_effect_at_once(service: Service) -> None:
    job = ask(service, seconds=60.0)
    with running(service):
        until(lambda: service.job("lab", job).progress_what == "waiting" and service.job("lab", job).worker)
        seen = service.job("lab", job).revision
        until(lambda: service.job("lab", job).revision > seen)
        service.cancel("lab", job)
        assert ended(service, "lab", job, within_s=5.0).state is State.CANCELLED
    assert list(service.store.blobs.work.iterdir()) == []


def test_a_running_job_can_be_deleted(service: Service) -> None:
    uploaded(service)
    job = ask(service, seconds=60.0, subject="S01", files=["walk.txt"])
    with running(service):
        until(lambda: service.job("lab", job).state is State.RUNNING)
        service.delete_subject("lab", "S01")
        with pytest.raises(NotFound):
            service.job("lab", job)
        until(lambda: not list(service.store.blobs.work.iterdir()), within_s=5.0)
        other = ask(service, number=2)
        assert ended(service, "lab", other).state is State.DONE


def test_a_runner_that_stops_gives_its_jobs_back_as_good_as_new(service: Service) -> None:
    job = ask(service, seconds=60.0)
    with running(service):
        until(lambda: service.job("lab", job).state is State.RUNNING)
    row = service.job("lab", job)
    assert (row.state, row.losses, row.worker) == (State.QUEUED, 0, None)


def test_results_do_not_depend_on_the_number_of_runners(service: Service) -> None:
    jobs = [ask(service, number=k) for k in range(12)]
    with running(service), running(service):
        until(lambda: all_done(service))
    for k, job in enumerate(jobs):
        assert json.loads(service.result("lab", job) or "")["square"] == k**2
        assert service.job("lab", job).attempt == 1


def test_a_kind_that_this_version_does_not_know_fails_with_a_word(service: Service) -> None:
    job = ask(service, number=1)
    service.kinds = {}
    with running(service):
        row = ended(service, "lab", job)
    assert row.failure is not None
    assert row.failure.kind == "WorkerMismatch"
