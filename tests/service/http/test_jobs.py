"""Jobs over HTTP, from the request to the files; the jobs are tiny."""

from __future__ import annotations

import io
import json
import zipfile

import pytest

from scaling_service.service.jobs.service import Service
from tests.service.http.served import Served, serving, settings_in
from tests.service.jobs.services import ended, running
from tests.service.jobs.tiny import TINY

ABSENT = "0" * 64


def ask(tiny: Served, **request: object) -> str:
    answer = tiny.call("POST", "/v1/tiny", json=request)
    assert answer.status_code == 202, answer.text
    assert answer.headers["Location"] == f"/v1/jobs/{answer.json()['id']}"
    return str(answer.json()["id"])


def done(service: Service, job: str) -> None:
    with running(service):
        ended(service, "local", job)


def test_the_same_request_finds_the_same_job_and_its_result(tiny: Served) -> None:
    job = ask(tiny, number=7)
    waiting = tiny.call("POST", "/v1/tiny", json={"number": 7, "seconds": 0.0})  # a default, written out
    assert (waiting.status_code, waiting.json()["id"], waiting.json()["state"]) == (202, job, "queued")
    assert ask(tiny, number=8) != job
    done(tiny.service, job)
    again = tiny.call("POST", "/v1/tiny", json={"number": 7})
    assert (again.status_code, again.json()["id"], again.json()["state"]) == (200, job, "done")
    assert tiny.call("GET", f"/v1/jobs/{job}/result").json()["square"] == 49


def test_every_link_of_a_job_leads_somewhere(tiny: Served) -> None:
    job = ask(tiny, number=3)
    done(tiny.service, job)
    for name, path in tiny.call("GET", f"/v1/jobs/{job}").json()["links"].items():
        assert tiny.call("GET", path).status_code == 200, name


def test_files_one_by_one_and_as_an_archive(tiny: Served) -> None:
    job = ask(tiny, number=12)
    done(tiny.service, job)
    (file,) = tiny.call("GET", f"/v1/jobs/{job}/files").json()["items"]
    assert (file["name"], file["size"]) == ("square.txt", 3)
    one = tiny.call("GET", f"/v1/jobs/{job}/files/square.txt")
    assert one.text == "144"
    assert (
        tiny.call(
            "GET", f"/v1/jobs/{job}/files/square.txt", headers={"If-None-Match": one.headers["ETag"]}
        ).status_code
        == 304
    )
    packed = tiny.call("GET", f"/v1/jobs/{job}/files.zip")
    with zipfile.ZipFile(io.BytesIO(packed.content)) as archive:
        assert archive.testzip() is None
        assert {name: archive.read(name) for name in archive.namelist()} == {"square.txt": b"144"}
    assert tiny.call("GET", f"/v1/jobs/{job}/files.zip").content == packed.content
    assert tiny.call("GET", f"/v1/jobs/{job}/files/..%2F..%2Fjobs").status_code == 404


def test_a_job_that_waits_has_no_result_and_says_why(tiny: Served) -> None:
    job = ask(tiny, number=1)
    for what in ("result", "files.zip"):
        answer = tiny.call("GET", f"/v1/jobs/{job}/{what}")
        assert (answer.status_code, answer.json()["problem"]) == (404, "the job has no result: it is queued")


def test_a_failure_is_reported_in_the_words_of_the_command_line(tiny: Served) -> None:
    job = ask(tiny, fails=True)
    done(tiny.service, job)
    failure = tiny.call("GET", f"/v1/jobs/{job}").json()["failure"]
    assert (failure["kind"], failure["field"]) == ("MarkerMissing", "markers.RASIS")
    assert failure["remedy"] in tiny.call("GET", f"/v1/jobs/{job}/result").json()["remedy"]


def test_events_tell_of_progress_until_the_end(tiny: Served) -> None:
    job = ask(tiny, number=2, seconds=1.5)
    with tiny.call("GET", f"/v1/jobs/{job}/events", stream=True) as stream, running(tiny.service):
        assert stream.headers["Content-Type"].startswith("text/event-stream")
        events = [block.split("\n") for block in stream.text.strip().split("\n\n")]
    numbers = [int(lines[0].removeprefix("id: ")) for lines in events]
    jobs = [json.loads(lines[2].removeprefix("data: ")) for lines in events]
    assert all(lines[1] == "event: job" for lines in events)
    assert numbers == sorted(set(numbers)) == [found["revision"] for found in jobs]
    assert (jobs[0]["state"], jobs[-1]["state"]) == ("queued", "done")
    shares = [found["progress"]["share"] for found in jobs if found["state"] == "running"]
    assert len(shares) >= 3
    assert shares == sorted(shares)
    seen = {"Last-Event-ID": str(numbers[-1])}
    assert tiny.call("GET", f"/v1/jobs/{job}/events", headers=seen).status_code == 204
    late = tiny.call("GET", f"/v1/jobs/{job}/events", headers={"Last-Event-ID": str(numbers[-2])})
    assert late.text.count("event: job") == 1


def test_a_job_that_did_not_change_is_not_sent_again(tiny: Served) -> None:
    job = ask(tiny, number=4)
    known = {"If-None-Match": tiny.call("GET", f"/v1/jobs/{job}").headers["ETag"]}
    assert tiny.call("GET", f"/v1/jobs/{job}", headers=known).status_code == 304
    done(tiny.service, job)
    assert tiny.call("GET", f"/v1/jobs/{job}", headers=known).status_code == 200


def test_delete_cancels_what_waits_or_runs_and_deletes_what_is_over(tiny: Served) -> None:
    waiting, long = ask(tiny, number=5), ask(tiny, number=6, seconds=60)
    cancelled = tiny.call("DELETE", f"/v1/jobs/{waiting}")
    assert (cancelled.status_code, cancelled.json()["state"]) == (202, "cancelled")
    assert tiny.call("DELETE", f"/v1/jobs/{waiting}").status_code == 204
    assert tiny.call("GET", f"/v1/jobs/{waiting}").status_code == 404
    with running(tiny.service):
        while tiny.call("GET", f"/v1/jobs/{long}").json()["state"] != "running":
            pass
        assert tiny.call("DELETE", f"/v1/jobs/{long}").json()["state"] in ("cancelling", "cancelled")
        ended(tiny.service, "local", long)
    assert tiny.call("GET", f"/v1/jobs/{long}").json()["state"] == "cancelled"


def test_lists_by_state_kind_and_subject(tiny: Served) -> None:
    jobs = [ask(tiny, number=k) for k in range(5)]
    tiny.call("DELETE", f"/v1/jobs/{jobs[0]}")

    def listed(**query: str) -> list[str]:
        return [item["id"] for item in tiny.call("GET", "/v1/jobs", params=query).json()["items"]]

    assert listed() == jobs[::-1]
    assert listed(state="cancelled") == jobs[:1]
    assert listed(kind="tiny", state="queued", limit="2") == jobs[:2:-1]
    assert listed(kind="other") == listed(subject="S01") == []


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", f"/v1/jobs/{ABSENT}", 404),
        ("GET", "/v1/jobs/1", 422),
        ("GET", "/v1/jobs?state=odd", 422),
        ("GET", "/v1/nothing", 404),
        ("POST", "/v1/dynamics", 404),
        ("PATCH", "/v1/jobs", 405),
    ],
)
def test_what_there_is_not(tiny: Served, method: str, path: str, status: int) -> None:
    answer = tiny.call(method, path)
    assert (answer.status_code, answer.headers["Content-Type"]) == (status, "application/problem+json")
    if status == 405:
        assert answer.headers["Allow"] == "GET"


def test_a_queue_that_is_full_says_when_to_come_back(tmp_path) -> None:
    with serving(settings_in(tmp_path, limit_queue=2), TINY) as served:
        codes = [served.call("POST", "/v1/tiny", json={"number": k}).status_code for k in range(3)]
        assert codes == [202, 202, 429]
        assert int(served.call("POST", "/v1/tiny", json={"number": 9}).headers["Retry-After"]) >= 1
        assert served.call("POST", "/v1/tiny", json={"number": 0}).status_code == 202  # it waits already


def test_requests_that_are_not_the_kinds_are_refused(tiny: Served) -> None:
    answer = tiny.call("POST", "/v1/tiny", json={"numbr": 1})
    assert (answer.status_code, answer.json()["field"]) == (422, "numbr")
