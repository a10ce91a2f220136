"""Stretches of files, so that a long recording is looked at without fetching all of it."""

from __future__ import annotations

import pytest

from tests.service.http.served import Served
from tests.service.http.test_subjects import person

CONTENT = bytes(range(256)) * 3000
ADDRESS = "/v1/subjects/S01/files/walk.trc"


@pytest.fixture
def kept(served: Served) -> Served:
    served.call("POST", "/v1/subjects", json=person("S01"))
    served.call("PUT", ADDRESS, data=CONTENT)
    return served


@pytest.mark.parametrize(
    ("asked", "first", "last"),
    [
        ("bytes=0-0", 0, 0),
        ("bytes=1000-1999", 1000, 1999),
        ("bytes=300000-700000", 300_000, 700_000),
        ("bytes=767999-", 767_999, 767_999),
        ("bytes=700000-999999999", 700_000, 767_999),
        ("bytes=-5", 767_995, 767_999),
        ("bytes=-999999999", 0, 767_999),
    ],
)
def test_a_stretch_is_sent_alone(kept: Served, asked: str, first: int, last: int) -> None:
    answer = kept.call("GET", ADDRESS, headers={"Range": asked})
    assert (answer.status_code, answer.content) == (206, CONTENT[first : last + 1])
    assert answer.headers["Content-Range"] == f"bytes {first}-{last}/{len(CONTENT)}"
    assert int(answer.headers["Content-Length"]) == last - first + 1


@pytest.mark.parametrize("asked", ["bytes=5-2", "bytes=a-b", "bytes=0-1,4-5", "lines=0-1", "bytes=-", ""])
def test_what_cannot_be_understood_gets_all(kept: Served, asked: str) -> None:
    answer = kept.call("GET", ADDRESS, headers={"Range": asked})
    assert (answer.status_code, answer.content) == (200, CONTENT)
    assert answer.headers["Accept-Ranges"] == "bytes"


@pytest.mark.parametrize("asked", ["bytes=768000-", "bytes=999999-1000000", "bytes=-0"])
def test_beyond_the_end_there_is_nothing(kept: Served, asked: str) -> None:
    answer = kept.call("GET", ADDRESS, headers={"Range": asked})
    assert answer.status_code == 416
    assert answer.headers["Content-Range"] == "bytes */768000"
    assert answer.json()["remedy"]


def test_a_stretch_of_another_version_is_not_sent(kept: Served) -> None:
    current = kept.call("GET", ADDRESS).headers["ETag"]
    same = kept.call("GET", ADDRESS, headers={"Range": "bytes=0-9", "If-Range": current})
    other = kept.call("GET", ADDRESS, headers={"Range": "bytes=0-9", "If-Range": '"other"'})
    assert (same.status_code, other.status_code) == (206, 200)
