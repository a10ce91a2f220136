"""The example: one request fills an empty installation, and the whole tour works on it."""

from __future__ import annotations

from scaling_service.documents.jobs import State
from tests.service.http.served import Served
from tests.service.jobs.services import running


def test_one_request_puts_a_person_that_everything_can_be_asked_of(served: Served) -> None:
    answer = served.call("POST", "/v1/examples")
    assert (answer.status_code, answer.json()) == (201, {"subjects": ["example"]})
    again = served.call("POST", "/v1/examples")
    assert (again.status_code, again.elapsed.total_seconds() < 0.5) == (200, True)
    client = served.client()
    with running(served.service):
        proof = client.wait(client.ask("proofs", subject="example"), 60.0)
        result = client.result(proof)
    assert proof.state is State.DONE
    assert (result["axes"]["up"], result["axes"]["forward"]) == ("+z", "+x")
    assert all(marker["label"].startswith("V:") for marker in result["markers"])
    assert {file["role"] for file in result["files"]} >= {"trials.static", "bones.pelvis", "image_markers"}
    assert [p["severity"] for p in result["problems"]] == ["warning"]  # what is hidden shows already
    assert "LLM and LMM look exchanged" in result["problems"][0]["problem"]


def test_a_subject_of_that_name_is_not_touched(served: Served) -> None:
    mine = {"subject": {"id": "example"}, "model": "squat_4dof", "trials": {"static": "mine.trc"}}
    served.call("POST", "/v1/subjects", json=mine)
    answer = served.call("POST", "/v1/examples")
    assert (answer.status_code, answer.json()["field"]) == (409, "subject")
    assert served.call("GET", "/v1/subjects/example").json()["document"] == mine


def test_what_broke_off_is_completed(served: Served, quick_examples: None) -> None:
    served.call("POST", "/v1/examples")
    whole = served.call("GET", "/v1/subjects/example/files").json()
    served.call("DELETE", "/v1/subjects/example/files/static.trc")
    assert served.call("POST", "/v1/examples").status_code == 201
    assert served.call("GET", "/v1/subjects/example/files").json() == whole


def test_each_owner_has_examples_of_their_own(served: Served, quick_examples: None) -> None:
    ours, theirs = served.key("ours"), served.key("theirs")
    names = served.call("POST", "/v1/examples?persons=3", ours).json()["subjects"]
    assert names == ["example", "example_2", "example_3"]
    assert served.call("GET", "/v1/subjects/example", theirs).status_code == 404
    assert served.call("POST", "/v1/examples?persons=6", ours).status_code == 422
