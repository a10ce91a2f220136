"""Who is let in, and what each sees."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import requests

from scaling_service.service.http.jobs import make_example
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.service.store import keys
from tests.service.http.served import Served, serving, settings_in
from tests.service.http.test_subjects import person
from tests.service.jobs.services import ended, running
from tests.service.jobs.tiny import TINY

ONE = {"subject": "S01", "job": "0" * 64, "name": "walk.trc", "path": "square.txt"}


def routes(served: Served) -> list[tuple[str, str]]:
    document = served.call("GET", "/openapi.json").json()
    return [(method.upper(), path) for path, found in document["paths"].items() for method in found]


def body_of(path: str) -> dict[str, Any]:
    """The example of a route that asks for a job."""
    kinds = {f"/v1/{kind.route}": kind for kind in KINDS.values()}
    return make_example(kinds[path].request) if path in kinds else person("S02")


def test_another_keys_things_are_invisible_on_every_route(tmp_path: Path) -> None:
    both = dict(KINDS) | TINY
    with serving(settings_in(tmp_path), both, loopback=False) as served:
        mine, other = served.key("mine"), served.key("other")
        assert served.call("POST", "/v1/subjects", mine, json=person("S01")).status_code == 201
        assert served.call("PUT", "/v1/subjects/S01/files/walk.trc", mine, data=b"x").status_code == 200
        job = served.call("POST", "/v1/tiny", mine, json={"number": 3, "subject": "S01"}).json()["id"]
        with running(served.service):
            ended(served.service, "mine", job)
        tried = 0
        for method, template in routes(served):
            if template.startswith("/v1/tiny"):
                continue
            path = template.format(**ONE | {"job": job})
            options = {"json": body_of(template)} if method == "POST" else {}
            options = {"data": b"theirs"} if method == "PUT" else options
            answer = served.call(method, path, other, **options)
            if "{" in template or template.startswith(("/v1/scalings", "/v1/comparisons", "/v1/batches")):
                tried += 1
                assert answer.status_code == 404, (method, template, answer.text)
                absent = served.call(method, template.format(**ONE | {"subject": "S99"}), other, **options)
                assert absent.json()["type"] == answer.json()["type"]
            elif method == "GET" and template.startswith("/v1/"):
                tried += 1
                assert '"S01"' not in answer.text
                assert job not in answer.text
        assert tried >= 22
        assert served.call("GET", f"/v1/jobs/{job}", mine).status_code == 200
        assert served.call("GET", "/v1/subjects/S01/files/walk.trc", mine).content == b"x"


def test_every_route_but_the_open_ones_needs_a_key(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path), loopback=False) as served:
        for key in (None, "scs_000000000000_wrong", "x"):
            for method, template in routes(served):
                answer = served.call(method, template.format(**ONE), key)
                if template in ("/health", "/ready"):
                    assert answer.status_code == 200
                else:
                    assert answer.status_code in (401, 429), (method, template)
                    assert answer.headers.get("WWW-Authenticate") == "Bearer" or answer.status_code == 429


def test_a_key_opens_until_it_is_revoked(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path), loopback=False) as served:
        key = served.key("lab")
        assert served.call("GET", "/v1/jobs", key).status_code == 200
        keys.revoke(served.service.store.database, key.split("_")[1])
        assert served.call("GET", "/v1/jobs", key).status_code == 401


def test_on_this_machine_no_key_is_needed_until_there_is_one(served: Served) -> None:
    assert served.call("GET", "/v1/jobs").status_code == 200
    key = served.key("lab")
    assert served.call("GET", "/v1/jobs").status_code == 401
    assert served.call("GET", "/v1/jobs", key).status_code == 200


def test_wrong_keys_are_slowed_down_and_lock_out_no_right_one(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, request_rate=0.1, request_burst=20), loopback=False) as served:
        key = served.key("lab")
        codes = [served.call("GET", "/v1/jobs", f"scs_0_{k}").status_code for k in range(30)]
        assert codes == [401] * 20 + [429] * 10
        assert served.call("GET", "/v1/jobs", key).status_code == 200


FOREIGN: list[dict[str, str]] = [
    {"Origin": "http://evil.example"},
    {"Origin": "null"},
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
]


@pytest.mark.parametrize("headers", FOREIGN)
def test_a_page_of_another_site_cannot_change_anything(served: Served, headers: dict[str, str]) -> None:
    changing = [(method, path.format(**ONE)) for method, path in routes(served) if method != "GET"]
    assert len(changing) >= 21
    for method, path in changing:
        answer = served.call(method, path, headers=headers | {"Content-Type": "text/plain"}, data=b"")
        assert (answer.status_code, answer.json()["type"]) == (403, "urn:scaling-service:ForeignOrigin"), path
    assert served.call("GET", "/v1/subjects", headers=headers).json()["items"] == []


def test_the_services_own_page_and_whoever_has_a_key_may_change_things(served: Served) -> None:
    own = {"Origin": served.url, "Sec-Fetch-Site": "same-origin"}
    assert served.call("POST", "/v1/subjects", headers=own, json=person("S01")).status_code == 201
    key = served.key(
        "lab"
    )  # a proxy's name is another origin; a key is nothing that browsers send by themselves
    assert served.call("POST", "/v1/subjects", key, headers=FOREIGN[0], json=person("S01")).status_code == 201


def test_a_page_of_another_site_cannot_ask_through_the_browser(served: Served) -> None:
    assert served.call("GET", "/v1/jobs", headers={"Host": "evil.example"}).status_code == 421
    port = served.url.rpartition(":")[2]
    assert served.call("GET", "/v1/jobs", headers={"Host": f"localhost:{port}"}).status_code == 200
    asked = requests.options(
        served.url + "/v1/subjects",
        headers={"Origin": "https://evil.example", "Access-Control-Request-Method": "POST"},
        timeout=10,
    )
    assert asked.status_code == 405
    assert not [name for name in asked.headers if name.lower().startswith("access-control")]


def test_who_asks_too_fast_is_asked_to_wait(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path, request_rate=0.5, request_burst=3)) as served:
        answers = [served.call("GET", "/v1/jobs") for _ in range(4)]
        assert [answer.status_code for answer in answers] == [200, 200, 200, 429]
        assert 1 <= int(answers[-1].headers["Retry-After"]) <= 3
        assert served.call("GET", "/health").status_code == 200


@pytest.mark.parametrize("path", ["/v1/jobs", "/v1/jobs/x", "/nothing", "/docs", "/openapi.json", "/metrics"])
def test_every_answer_keeps_browsers_careful(served: Served, path: str) -> None:
    headers = served.call("GET", path).headers
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert not re.search("uvicorn|python", str(headers), re.IGNORECASE)
