"""The same request has one name; any difference gives another."""

from __future__ import annotations

import hashlib
import json
import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scaling_service.capabilities.scaling.job import ScalingRequest
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.service.jobs.submission import (
    _list_files,
    code_version,
    hash_specification,
    write_canonical,
    write_specification,
)

BASE = {
    "kind": "scaling",
    "request": {"subject": "S01"},
    "documents": {"S01": {"model": "a"}},
    "inputs": {"S01/walk.trc": "ab"},
    "code": "1",
    "owner": "lab",
}
VALUES = st.recursive(
    st.none() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(st.text(max_size=4), VALUES, max_size=4))
def test_order_and_spaces_do_not_matter(document: dict[str, object]) -> None:
    turned = dict(reversed(document.items()))
    again = json.loads(json.dumps(turned, indent=3))
    assert write_canonical(again) == write_canonical(document)
    assert json.loads(write_canonical(document)) == document


def test_the_name_is_the_digest_of_what_was_asked() -> None:
    text = write_specification(**BASE)  # type: ignore[arg-type]
    assert hash_specification(text) == hashlib.sha256(text.encode()).hexdigest()
    assert set(json.loads(text)) == {"kind", "request", "documents", "inputs", "code_version", "owner"}


@pytest.mark.parametrize("part", BASE)
def test_every_part_counts(part: str) -> None:
    changed = BASE | {part: "other" if isinstance(BASE[part], str) else {"other": "1"}}
    assert hash_specification(write_specification(**changed)) != hash_specification(
        write_specification(**BASE)
    )  # type: ignore[arg-type]


def test_numbers_that_are_none_have_no_name() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_canonical({"x": float("nan")})


def test_defaults_are_written_out() -> None:
    short = ScalingRequest.model_validate({"subject": "S01"})
    long = ScalingRequest.model_validate(json.loads(short.model_dump_json()))
    assert write_canonical(short.model_dump(mode="json")) == write_canonical(long.model_dump(mode="json"))
    assert short.model_dump(mode="json")["settings"]["calibration"]["n_frames"] == 100


def test_the_code_has_a_version_and_a_digest() -> None:
    assert code_version() == code_version()
    assert code_version().split("+")[1].isalnum()


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_has_a_request_that_travels_and_a_function_that_can_be_named(name: str) -> None:
    kind = KINDS[name]
    least: dict[str, object] = {"subjects": ["S01"]} if name == "batch" else {"subject": "S01"}
    request = kind.request.model_validate(least)
    assert kind.request.model_validate_json(request.model_dump_json()) == request
    assert request.subjects == ("S01",)
    assert pickle.loads(pickle.dumps(kind.work)) == kind.work
    with pytest.raises(ValueError, match="extra"):
        kind.request.model_validate({**least, "unknown": 1})


def test_the_web_page_changes_no_result(tmp_path: Path) -> None:
    for name in (
        "a.py",
        "api/app.py",
        "service/page/src/x.json",
        "service/page/node_modules/y/z.py",
        "web/data.csv",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert {name for name, _ in _list_files(tmp_path, "")} == {"a.py", "api/app.py", "web/data.csv"}
