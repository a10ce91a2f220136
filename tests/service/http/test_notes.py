"""What people write about a subject's results: kept beside it, signed, gone with it."""

from __future__ import annotations

from typing import Any

import pytest

from tests.service.http.served import Served

SUBJECT = {"subject": {"id": "S01"}}
PATH = "/v1/subjects/S01/note"


def test_a_note_is_written_signed_and_loses_its_signature_when_it_is_changed(served: Served) -> None:
    served.call("POST", "/v1/subjects", json=SUBJECT)
    assert served.call("GET", PATH).json()["text"] == ""
    signed = {"text": "Left knee slipped <b>", "signed_by": "A. Smith", "results": ["0" * 64]}
    kept = served.call("PUT", PATH, json=signed).json()
    assert served.call("GET", PATH).json() == kept
    assert {name: kept[name] for name in signed} == signed
    changed = served.call("PUT", PATH, json={"text": "It did not"}).json()
    assert changed["signed_by"] is None
    assert changed["updated_at"] > kept["updated_at"]


def test_a_note_goes_with_its_subject_and_is_its_owners_alone(served: Served) -> None:
    ours, theirs = served.key("ours"), served.key("theirs")
    for key in (ours, theirs):
        served.call("POST", "/v1/subjects", key, json=SUBJECT)
    served.call("PUT", PATH, ours, json={"text": "ours"})
    assert served.call("GET", PATH, theirs).json()["text"] == ""
    served.call("DELETE", "/v1/subjects/S01", ours)
    assert served.call("GET", PATH, ours).status_code == 404
    assert served.call("PUT", PATH, ours, json={"text": "late"}).status_code == 404
    served.call("POST", "/v1/subjects", ours, json=SUBJECT)
    assert served.call("GET", PATH, ours).json()["text"] == ""


@pytest.mark.parametrize(
    "content", [{}, {"text": "x" * 20_001}, {"text": "x", "signed_by": ""}, {"text": "x", "more": 1}]
)
def test_what_is_no_note_is_refused(served: Served, content: dict[str, Any]) -> None:
    served.call("POST", "/v1/subjects", json=SUBJECT)
    answer = served.call("PUT", PATH, json=content)
    assert answer.status_code == 422
    assert answer.json()["field"]
