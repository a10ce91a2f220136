"""Links for browsers: one file, one minute, no key."""

from __future__ import annotations

import pytest

from scaling_service.service.http.callers import LIFETIME_S, Tickets
from tests.service.http.served import Served
from tests.service.http.test_subjects import person

FILE = "/v1/subjects/S01/files/walk%20%C3%BC.trc"


@pytest.fixture
def lab(served: Served) -> tuple[Served, str]:
    """A service with keys, and a file of an owner."""
    key = served.key("lab")
    served.call("POST", "/v1/subjects", key, json=person("S01"))
    served.call("PUT", FILE, key, data=b"content")
    return served, key


def test_a_link_opens_its_file_and_nothing_else(lab: tuple[Served, str]) -> None:
    served, key = lab
    link = served.call("POST", "/v1/links", key, json={"path": FILE}).json()["path"]
    assert served.call("GET", FILE).status_code == 401
    assert served.call("GET", link).content == b"content"
    ticket = link.partition("?")[2]
    for method, path in (
        ("GET", "/v1/subjects/S01"),
        ("GET", "/v1/subjects"),
        ("GET", "/v1/subjects/S01/files/other.trc"),
        ("PUT", FILE),
        ("DELETE", FILE),
        ("POST", "/v1/links"),
    ):
        assert served.call(method, f"{path}?{ticket}", json={}).status_code == 401, (method, path)


def test_a_link_is_made_for_files_only_and_by_who_has_a_key(lab: tuple[Served, str]) -> None:
    served, key = lab
    assert served.call("POST", "/v1/links", json={"path": FILE}).status_code == 401
    for path in ("/v1/subjects/S01", "/v1/jobs", "https://example.org/x", "/metrics", "", "//v1/jobs"):
        answer = served.call("POST", "/v1/links", key, json={"path": path})
        assert (answer.status_code, answer.json()["field"]) == (422, "path"), path
    assert served.call("POST", "/v1/links", key, json={}).status_code == 422


def test_a_link_of_another_owner_shows_what_that_owner_has(lab: tuple[Served, str]) -> None:
    served, _ = lab
    link = served.call("POST", "/v1/links", served.key("other"), json={"path": FILE}).json()["path"]
    assert served.call("GET", link).status_code == 404


def test_tickets_end_and_cannot_be_made_elsewhere() -> None:
    now = 1000.0
    tickets, path = Tickets(clock=lambda: now), "/v1/jobs/1/files.zip"
    ticket, until_s = tickets.issue("lab", path)
    assert until_s == 1000 + LIFETIME_S
    for forged in ("", "...", ticket[:-1], f"{ticket}A", "é", "9" * 5000, Tickets().issue("lab", path)[0]):
        assert tickets.owner_of(forged, path) is None, forged
    now = until_s
    assert tickets.owner_of(ticket, path) == "lab"
    now = until_s + 1
    assert tickets.owner_of(ticket, path) is None
