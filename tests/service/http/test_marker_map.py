"""The marker map of a laboratory: one for each owner, given as a whole."""

from __future__ import annotations

from typing import Any

import pytest

from tests.service.http.served import Served

PATH = "/v1/marker-map"


def test_a_map_is_kept_and_replaced_as_a_whole(served: Served) -> None:
    assert served.call("GET", PATH).json() == {"labels": {}, "updated_at": None}
    first = served.call("PUT", PATH, json={"labels": {"KNIE r": "RLFE", "<b>": "RMFE"}})
    assert first.status_code == 200
    assert served.call("GET", PATH).json() == first.json()
    assert first.json()["labels"] == {"KNIE r": "RLFE", "<b>": "RMFE"}
    served.call("PUT", PATH, json={"labels": {"x": "RLM"}})
    assert served.call("GET", PATH).json()["labels"] == {"x": "RLM"}


def test_laboratories_do_not_see_each_others_map(served: Served) -> None:
    ours, theirs = served.key("ours"), served.key("theirs")
    served.call("PUT", PATH, ours, json={"labels": {"x": "RLM"}})
    assert served.call("GET", PATH, theirs).json()["labels"] == {}
    assert served.call("GET", PATH, served.key("ours")).json()["labels"] == {"x": "RLM"}


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"labels": []},
        {"labels": {"": "RLM"}},
        {"labels": {"x": ""}},
        {"labels": {"x": "y" * 201}},
        {"labels": {"x": 1}},
        {"labels": {str(k): "RLM" for k in range(2001)}},
        {"labels": {}, "more": 1},
    ],
)
def test_what_is_no_map_is_refused(served: Served, content: dict[str, Any]) -> None:
    answer = served.call("PUT", PATH, json=content)
    assert answer.status_code == 422
    assert answer.json()["field"]
    assert served.call("GET", PATH).json()["labels"] == {}
