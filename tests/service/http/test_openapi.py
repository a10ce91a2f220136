"""The document of all routes: its examples run as they stand, and no request of its kind breaks anything."""

from __future__ import annotations

import html
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.kinds import KINDS
from tests.service.http.example import example_files, put_example
from tests.service.http.served import Served
from tests.service.jobs.services import running


def operations(served: Served) -> dict[tuple[str, str], dict[str, Any]]:
    document = served.call("GET", "/openapi.json").json()
    return {(m.upper(), path): op for path, ops in document["paths"].items() for m, op in ops.items()}


@pytest.mark.costly
def test_examples_run_as_they_stand_and_results_follow_their_schemas(served: Served, tmp_path: Path) -> None:
    client = served.client()
    found = operations(served)
    (subject,) = found["POST", "/v1/subjects"]["requestBody"]["content"]["application/json"][
        "examples"
    ].values()
    assert client.put_subject(subject["value"]).id == "S01"
    put_example(client, example_files(tmp_path / "lab"))
    with running(served.service):
        for kind in (kind for kind in KINDS.values() if kind.route is not None):
            body = found["POST", f"/v1/{kind.route}"]["requestBody"]["content"]["application/json"]
            (example,) = body["examples"].values()
            job = client.ask(kind.route, **example["value"])
            assert client.wait(job, 600.0).state is State.DONE
            assert kind.result is not None
            TypeAdapter(kind.result).validate_python(client.result(job), strict=False)
            assert client.ask(kind.route, **example["value"]).state is State.DONE


def test_the_page_shows_every_route_with_a_command_that_can_be_pasted(served: Served) -> None:
    page = served.call("GET", "/docs")
    assert "<script" not in page.text
    assert not re.search(r'(src|href)="http', page.text)
    commands = [
        html.unescape(text)
        for text in re.findall(r"<pre><code[^>]*>(.*?)</code></pre>", page.text, re.DOTALL)
    ]
    found = operations(served)
    assert len(commands) == len(found)
    for command in commands:
        words = shlex.split(command)
        assert words[0] == "curl"
        if "--json" in words:
            json.loads(words[words.index("--json") + 1])


@pytest.mark.costly
def test_no_request_of_any_form_breaks_the_service(
    served: Served, tmp_path: Path, quick_examples: None
) -> None:
    # Left out: that all data of the schemas' form are accepted; files must be there, and numbers make sense.
    # And that what was deleted is gone: DELETE cancels a job that is not over, and says so by 202.
    program = Path(sys.executable).with_name("schemathesis")
    options = [
        "--exclude-checks",
        "positive_data_acceptance,use_after_free",
        "--max-examples",
        "4",
        "--seed",
        "1",
        "--no-color",
    ]
    with running(served.service):  # jobs that are asked for end, and their events with them
        done = subprocess.run(
            [str(program), "run", f"{served.url}/openapi.json", *options, "--warnings", "off"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
    assert done.returncode == 0, done.stdout[-4000:]
    generated = re.search(r"(\d+) generated", done.stdout)
    assert generated, done.stdout[-4000:]
    assert int(generated[1]) > 2000  # else little was tried
