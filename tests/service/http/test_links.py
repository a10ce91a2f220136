"""Links for browsers and colleagues: one file, until they end, no key."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from sqlalchemy import func, select, update

from scaling_service.service.store import keys, links, tables
from scaling_service.service.store.database import NowUs
from scaling_service.service.store.store import Store
from tests.service.http.served import Served, serving
from tests.service.http.test_subjects import person
from tests.service.store.fixtures import database_url, store

__all__ = ["database_url", "store"]

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


def test_a_link_opens_on_every_server_of_the_store(lab: tuple[Served, str]) -> None:
    """Also one that was made before a server started."""
    served, key = lab
    link = served.call("POST", "/v1/links", key, json={"path": FILE}).json()["path"]
    with serving(served.service.settings) as second:
        assert second.call("GET", link).content == b"content"
        assert second.call("DELETE", "/v1/links", key).status_code == 204
    assert served.call("GET", link).status_code == 401


def test_a_link_for_a_colleague_works_as_long_as_was_said(lab: tuple[Served, str]) -> None:
    served, key = lab
    made = served.call("POST", "/v1/links", key, json={"path": FILE, "lifetime_s": 7 * 86_400}).json()
    left = datetime.fromisoformat(made["until"]) - datetime.now(UTC)
    assert timedelta(days=7) - timedelta(minutes=1) < left <= timedelta(days=7, seconds=1)
    for lifetime_s in (0, -1, 31 * 86_400, 1.5, "60"):
        answer = served.call("POST", "/v1/links", key, json={"path": FILE, "lifetime_s": lifetime_s})
        assert (answer.status_code, answer.json()["field"]) == (422, "lifetime_s"), lifetime_s
    keys.revoke(served.service.store.database, key.split("_")[1])
    assert served.call("GET", made["path"]).status_code == 401


def test_tickets_end_and_cannot_be_made_elsewhere(store: Store) -> None:
    database, path = store.database, "/v1/jobs/1/files.zip"
    ticket, _ = links.issue(database, "lab", path, 60)
    assert links.find_owner(database, ticket, path) == "lab"
    assert links.find_owner(database, ticket, "/v1/jobs/2/files.zip") is None
    for forged in ("", "...", ticket[:-1], f"{ticket}A", "é", "\ud800", "9" * 5000):
        assert links.find_owner(database, forged, path) is None, forged
    with store.write() as connection:
        connection.execute(update(tables.links).values(until_us=NowUs() - 1))
    assert links.find_owner(database, ticket, path) is None
    links.issue(database, "lab", path, 60)
    with store.read() as connection:
        assert connection.scalar(select(func.count()).select_from(tables.links)) == 1  # the old one is gone


def test_links_of_an_owner_are_bounded(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(links, "MOST", 3)
    for number in range(3):
        links.issue(store.database, "lab", f"/v1/jobs/{number}/files.zip", 60)
    with pytest.raises(links.TooManyLinks):
        links.issue(store.database, "lab", "/v1/jobs/4/files.zip", 60)
    links.issue(store.database, "other", "/v1/jobs/4/files.zip", 60)
    links.end_all(store.database, "lab")
    links.issue(store.database, "lab", "/v1/jobs/4/files.zip", 60)
