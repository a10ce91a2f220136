"""The same over HTTP as by the command line."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest
import requests

from tests.safety.comparing import compare, tell_differences
from tests.safety.reading import read_file, reduce_document
from tests.safety.running import unpack_subject
from tests.safety.serving import serve
from tests.safety.snapshots import load_snapshot

FILES = ("standing.trc", "hips.trc", "walk.trc")
DOCUMENT = {
    "subject": {"id": "S01", "sex": "F", "height_m": 1.70, "mass_kg": 62.0},
    "model": "lower_limb_14dof",
    "trials": {"static": FILES[0], "calibration": [FILES[1]], "evaluation": [FILES[2]]},
}
WRITTEN = "scale/MB_am/"
"""Where the case ``scale`` has what the job makes, too."""

PATIENCE_S = 600.0


@pytest.mark.costly
def test_a_scaling_over_http_is_that_of_the_command_line(tmp_path: Path) -> None:
    unpack_subject("leg", tmp_path)
    stored = load_snapshot("scale")
    with serve(tmp_path) as url:
        job = _scale(f"{url}/v1", tmp_path / "recordings")
        result = requests.get(f"{url}/v1/jobs/{job}/result", timeout=30).json()
        found = list(compare(_known(stored[f"{WRITTEN}scaling.json"]), _known(reduce_document(result, {}))))
        for name in (name for name in stored if name.startswith(WRITTEN)):
            file = tmp_path / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(_get(f"{url}/v1/jobs/{job}/files/{name.removeprefix('scale/')}"))
            if not name.endswith("scaling.json"):
                found += compare(stored[name], read_file(file, {}), name)
        assert not found, tell_differences(found)
        assert json.loads((tmp_path / WRITTEN / "scaling.json").read_text()) == result


def _scale(api: str, recordings: Path) -> str:
    """Upload the subject, scale it, and wait; the job's name."""
    _post(f"{api}/subjects", DOCUMENT)
    for name in FILES:
        with (recordings / name).open("rb") as content:
            answer = requests.put(f"{api}/subjects/S01/files/{name}", data=content, timeout=30)
        assert answer.ok, answer.text
    asked = {"subject": "S01", "method": "MB_am", "settings": {"calibration": {"n_frames": 60}}}
    job: str = _post(f"{api}/scalings/optimised", asked)["id"]
    last = time.monotonic() + PATIENCE_S
    while (state := json.loads(_get(f"{api}/jobs/{job}")))["state"] not in ("done", "failed"):
        assert time.monotonic() < last, state
        time.sleep(0.2)
    assert state["state"] == "done", state
    return job


def _post(url: str, document: Any) -> Any:
    answer = requests.post(url, json=document, timeout=30)
    assert answer.ok, answer.text
    return answer.json()


def _get(url: str) -> bytes:
    answer = requests.get(url, timeout=30)
    assert answer.ok, answer.text
    return answer.content


def _known(document: dict[str, Any]) -> dict[str, Any]:
    """Without where it comes from: files are named otherwise in an upload."""
    return {key: value for key, value in document.items() if key != "input_hashes"}
