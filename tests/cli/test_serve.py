"""The commands of the service: what is refused, how it starts and ends, keys, data, settings."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest
import requests

from scaling_service.cli import main
from scaling_service.client import Client
from scaling_service.documents.jobs import State
from scaling_service.guide.pages import FOLDER
from tests.cli.serving import COMMAND, ENVIRONMENT, free_port, served, start
from tests.service.http.example import example_files, put_example

PAGE = (FOLDER / "service.md").read_text(encoding="utf-8")


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SCALING_SERVICE_DATA_DIRECTORY", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_others_are_not_let_in_without_keys(
    host: str, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--host", host, "--port", "0"]) == 2
    said = capsys.readouterr().err
    assert "there is no API key" in said
    assert "keys create" in said


def test_a_port_that_is_taken(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        assert main(["serve", "--port", str(other.getsockname()[1])]) == 2
    assert "cannot be listened on" in capsys.readouterr().err


def test_half_of_what_tls_needs_is_refused(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SCALING_SERVICE_TLS_KEY", "key.pem")
    assert main(["serve", "--port", "0"]) == 2
    assert "tls_certificate" in capsys.readouterr().err


def test_keys_are_made_listed_and_revoked(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", "create", "gait-lab", "--label", "page"]) == 0
    secret = capsys.readouterr().out.strip()
    assert re.fullmatch(r"scs_[0-9a-f]{12}_\S{43}", secret)
    key = secret.split("_")[1]
    assert main(["keys", "list"]) == 0
    listed = capsys.readouterr().out
    assert key in listed
    assert "gait-lab" in listed
    assert secret not in listed
    assert main(["keys", "revoke", key]) == 0
    assert main(["keys", "revoke", key]) == 2
    assert main(["keys", "list"]) == 0
    assert "revoked" in capsys.readouterr().out


def test_settings_are_shown_without_passwords(
    data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SCALING_SERVICE_DATABASE_URL", "postgresql://lab:secret@127.0.0.1/lab")
    assert main(["settings", "show"]) == 0
    shown = capsys.readouterr().out
    assert json.loads(shown)["data_directory"] == str(data)
    assert "secret" not in shown
    monkeypatch.setenv("SCALING_SERVICE_DATABASE_URL", "postgresql://lab:secret@db.example/lab")
    assert main(["settings", "show"]) == 2


def test_from_start_to_a_tidy_end_with_a_key(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["keys", "create", "lab"]) == 0
    key = capsys.readouterr().out.strip()
    files = example_files(tmp_path / "lab")
    with served(data) as url:
        assert requests.get(f"{url}/v1/jobs", timeout=10).status_code == 401
        with Client(url, key) as client:
            put_example(client, files)
            job = client.wait(client.ask("scalings/linear", subject="S01"), 60.0)
            assert client.result(job)["method"] == "MB"
            long = client.ask("scalings/optimised", subject="S01")
            list(zip(range(2), client.events(long), strict=False))  # it runs, or is done
    with served(data) as url, Client(url, key) as client:
        assert client.wait(long, 60.0).state is State.DONE
        assert client.job(job).state is State.DONE
    log = (tmp_path / "log").read_text()
    assert all(json.loads(line)["level"] for line in log.splitlines())
    assert not re.search(r"S0[12]|walk\.trc|" + re.escape(key), log)
    assert main(["data", "delete", "lab", "S01"]) == 0
    assert main(["data", "delete", "lab", "S02"]) == 0
    assert [path for path in (data / "blobs").rglob("*") if path.is_file()] == []


def test_an_open_event_stream_does_not_hold_up_the_end(data: Path, tmp_path: Path) -> None:
    files = example_files(tmp_path / "lab")
    process, url = start(data)
    with Client(url) as client:
        put_example(client, files)
        job = client.ask("batches", subjects=["S01"])
        with requests.get(f"{url}/v1/jobs/{job.id}/events", stream=True, timeout=30) as stream:
            next(stream.iter_content(1))
            begun = time.monotonic()
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0
            assert time.monotonic() - begun < 8.0
    assert process.stdout is not None
    process.stdout.close()


@pytest.mark.costly
def test_the_walk_through_of_the_guide(tmp_path: Path) -> None:
    found = re.search(r"<!-- walk-through -->\n```sh\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    assert found is not None
    example_files(tmp_path / "lab")
    (tmp_path / "scaling-service").write_text(f'#!/bin/sh\nexec {" ".join(COMMAND)} "$@"\n')
    (tmp_path / "scaling-service").chmod(0o755)
    text = found[1].replace(":8000", f":{(port := free_port())}").replace("serve", f"serve --port {port}", 1)
    done = subprocess.run(
        ["bash", "-eu", "-c", text],
        cwd=tmp_path / "lab",
        env=ENVIRONMENT | {"PATH": f"{tmp_path}:{ENVIRONMENT['PATH']}"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert '"method": "MB_am"' in (tmp_path / "lab" / "result.json").read_text()
    assert (tmp_path / "lab" / "results.zip").stat().st_size > 1000
    assert '"state":"done"' in done.stdout
