"""Subjects and their files over HTTP."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

from scaling_service.documents.reading import MAX_BYTES
from scaling_service.service.http.subjects import EXAMPLE
from tests.service.http.served import Served, serving, settings_in


def person(name: str, **changes: Any) -> dict[str, Any]:
    return EXAMPLE | {"subject": {"id": name}} | changes


def test_a_subject_is_new_then_replaced_then_gone(served: Served) -> None:
    first = served.call("POST", "/v1/subjects", json=person("S01"))
    assert (first.status_code, first.headers["Location"]) == (201, "/v1/subjects/S01")
    again = served.call("POST", "/v1/subjects", json=person("S01", model="squat_4dof"))
    assert (again.status_code, again.json()["document"]["model"]) == (200, "squat_4dof")
    assert served.call("DELETE", "/v1/subjects/S01").status_code == 204
    assert served.call("GET", "/v1/subjects/S01").status_code == 404


@pytest.mark.parametrize("name", ["Zoë Ü", "Šárka 3", "被験者"])
def test_names_are_in_any_alphabet(served: Served, name: str) -> None:
    place = f"/v1/subjects/{quote(name)}"
    made = served.call("POST", "/v1/subjects", json=person(name))
    assert (made.status_code, made.headers["Location"]) == (201, place)
    assert served.call("PUT", f"{place}/files/{quote(name)}.trc", data=b"x").status_code in (200, 201)
    assert served.call("GET", place).json()["document"]["subject"]["id"] == name


def test_the_message_is_that_of_the_command_line(served: Served) -> None:
    answer = served.call("POST", "/v1/subjects", json=person("S01") | {"modle": "x"})
    reported = answer.json()
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert (answer.status_code, reported["status"], reported["type"]) == (
        422,
        422,
        "urn:scaling-service:SubjectInvalid",
    )
    assert reported["detail"] == "modle: unknown key. Did you mean 'model'?"
    assert (reported["field"], reported["problem"], reported["remedy"]) == (
        "modle",
        "unknown key",
        "Did you mean 'model'?",
    )


@pytest.mark.parametrize(
    ("body", "kind", "status"),
    [
        (b"{", "application/json", 400),
        (b"[]", "application/json", 400),
        (b'{"a": NaN}', "application/json", 400),
        (b'{"a": "\\ud800"}', "application/json", 400),
        (b"\xff\xfe", "application/json", 400),
        (b"[" * 100_000, "application/json", 400),
        (b'{"a": ' + b"9" * 5000 + b"}", "application/json", 400),
        (b"{}", "text/plain", 415),
        (b"a: b", "application/yaml", 415),
        (b'{"a": "' + b"x" * MAX_BYTES + b'"}', "application/json", 413),
        (b"{}", "application/json", 422),
        (b'{"subject": {"id": "../S01"}}', "application/json", 422),
        (b'{"subject": {"id": "S01", "height_m": 1e999}}', "application/json", 422),
    ],
)
def test_bodies_that_cannot_be_used(served: Served, body: bytes, kind: str, status: int) -> None:
    answer = served.call("POST", "/v1/subjects", data=body, headers={"Content-Type": kind})
    assert answer.status_code == status
    assert answer.json()["remedy"]


def test_files_come_back_as_they_went(served: Served, tmp_path: Path) -> None:
    content = bytes(range(256)) * 20_000  # 5 MB: several chunks
    served.call("POST", "/v1/subjects", json=person("S01"))
    put = served.call("PUT", "/v1/subjects/S01/files/walk 1.c3d", data=content)
    assert put.json() == {
        "name": "walk 1.c3d",
        "size": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    got = served.call("GET", "/v1/subjects/S01/files/walk 1.c3d")
    assert got.content == content
    assert got.headers["Content-Security-Policy"].startswith("sandbox")
    known = {"If-None-Match": got.headers["ETag"]}
    assert served.call("GET", "/v1/subjects/S01/files/walk 1.c3d", headers=known).status_code == 304
    assert served.call("DELETE", "/v1/subjects/S01/files/walk 1.c3d").status_code == 204
    assert served.call("GET", "/v1/subjects/S01/files").json() == {"items": []}


@pytest.mark.parametrize(
    "name", ["..", "%2e%2e", "a%2Fb", "..%2F..%2Fetc%2Fpasswd", "subject.json", "%00", "x" * 300]
)
def test_names_that_are_paths_or_taken(served: Served, name: str, tmp_path: Path) -> None:
    served.call("POST", "/v1/subjects", json=person("S01"))
    assert served.call("PUT", f"/v1/subjects/S01/files/{name}", data=b"x").status_code in (404, 405, 422)
    assert served.call("GET", "/v1/subjects/S01/files").json() == {"items": []}


def test_an_upload_that_is_too_large_leaves_nothing(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, limit_upload_mb=1)) as served:
        served.call("POST", "/v1/subjects", json=person("S01"))
        reported = served.call("PUT", "/v1/subjects/S01/files/a.c3d", data=b"x" * 1_000_001)
        untold = served.call("PUT", "/v1/subjects/S01/files/a.c3d", data=iter([b"x" * 600_000] * 2))
        assert (reported.status_code, untold.status_code) == (413, 413)
        assert list((tmp_path / "data" / "scratch" / "uploads").iterdir()) == []
        assert served.call("GET", "/v1/subjects/S01/files").json() == {"items": []}


def test_a_subject_may_have_so_many_files(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, limit_files=2)) as served:
        served.call("POST", "/v1/subjects", json=person("S01"))
        codes = [
            served.call("PUT", f"/v1/subjects/S01/files/{k}.trc", data=b"x").status_code for k in (1, 2, 3)
        ]
        assert codes == [200, 200, 422]


def test_pages_go_through_all_of_them_once(served: Served) -> None:
    names = [f"S{k:02d}" for k in range(7)]
    for name in names:
        served.call("POST", "/v1/subjects", json=person(name))
    found, cursor = list[str](), ""
    while cursor is not None:
        page = served.call("GET", "/v1/subjects", params={"limit": 3, "cursor": cursor}).json()
        found += [item["id"] for item in page["items"]]
        cursor = page["next"]
    assert found == names[::-1]


@pytest.mark.parametrize(
    "query",
    [
        "limit=0",
        "limit=501",
        "limit=x",
        "cursor=!",
        "cursor=QUJD",
        "cursor=OTk5OTk5OTk5OTk5OTk5OTk5OTk5OTk5OSBh",
    ],
)
def test_pages_that_there_are_not(served: Served, query: str) -> None:
    assert served.call("GET", f"/v1/subjects?{query}").status_code == 422


def test_a_version_that_is_known_is_not_sent_again(served: Served) -> None:
    served.call("POST", "/v1/subjects", json=person("S01"))
    first = served.call("GET", "/v1/subjects/S01").headers["ETag"]
    assert served.call("GET", "/v1/subjects/S01", headers={"If-None-Match": first}).status_code == 304
    served.call("PUT", "/v1/subjects/S01/files/a.trc", data=b"x")
    assert served.call("GET", "/v1/subjects/S01", headers={"If-None-Match": first}).status_code == 200
