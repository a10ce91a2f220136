"""The container files: what they run starts here, too, and nothing runs with more rights than it needs."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import requests
import yaml

from scaling_service.client import Client
from scaling_service.documents.jobs import State
from scaling_service.service.jobs.settings import PREFIX, ServiceSettings
from tests.cli.serving import COMMAND, ENVIRONMENT, free_port
from tests.service.http.example import example_files, put_example
from tests.service.store.postgres import server

FOLDER = Path(__file__).resolve().parents[1] / "docker"
COMPOSE: dict[str, Any] = yaml.safe_load((FOLDER / "compose.yaml").read_text(encoding="utf-8"))
SERVICES: dict[str, Any] = COMPOSE["services"]


@pytest.mark.parametrize("name", SERVICES)
def test_nothing_has_more_rights_than_it_needs(name: str) -> None:
    service = SERVICES[name]
    assert int(service["user"].partition(":")[0]) > 0
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in service["security_opt"]
    assert not {"privileged", "cap_add", "devices", "network_mode", "pid"} & service.keys()
    assert all(port.startswith("127.0.0.1:") for port in service.get("ports", []))
    assert all(volume.partition(":")[0] in COMPOSE["volumes"] for volume in service["volumes"])


def test_every_variable_is_a_setting_and_no_secret_is_written() -> None:
    values = SERVICES["service"]["environment"]
    assert {name.removeprefix(PREFIX).lower() for name in values} <= ServiceSettings.model_fields.keys()
    assert "${POSTGRES_PASSWORD:?" in values[f"{PREFIX}DATABASE_URL"]
    assert "${POSTGRES_PASSWORD:?" in SERVICES["database"]["environment"]["POSTGRES_PASSWORD"]


def test_the_image_copies_what_there_is_and_ends_as_another_user() -> None:
    lines = (FOLDER / "Dockerfile").read_text(encoding="utf-8").splitlines()
    for line in lines:
        if line.startswith("COPY") and "--from" not in line:
            for source in line.split()[1:-1]:
                assert (FOLDER.parent / source).exists(), source
    users = [line.split()[1] for line in lines if line.startswith("USER")]
    assert users[-1] == "1000:1000"
    assert not re.search("latest", "\n".join(lines))


def test_what_compose_runs_computes_together(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed")
    dask = shutil.which("dask", path=str(Path(sys.executable).parent))
    assert dask is not None
    ports = {"8786": str(free_port()), "8000": str(free_port())}

    def here(words: list[str]) -> list[str]:
        joined = "\n".join(words).replace("scheduler:", "127.0.0.1:")
        joined = joined.replace("--host\nscheduler", "--host\n127.0.0.1")
        for old, new in ports.items():
            joined = joined.replace(old, new)
        return joined.replace("/tmp", str(tmp_path)).replace("0.0.0.0", "127.0.0.1").split("\n")

    environment = ENVIRONMENT | {
        "OMP_NUM_THREADS": "1",
        f"{PREFIX}DATA_DIRECTORY": str(tmp_path / "data"),
        f"{PREFIX}DATABASE_URL": server().new_database(),
        f"{PREFIX}DASK_ADDRESS": here([SERVICES["service"]["environment"][f"{PREFIX}DASK_ADDRESS"]])[0],
    }
    made = subprocess.run(
        [*COMMAND, "keys", "create", "my-lab"], env=environment, capture_output=True, text=True, check=True
    )
    started = []
    try:
        for name in ("scheduler", "worker", "service"):
            words = [*SERVICES[name].get("entrypoint", ["scaling-service"]), *SERVICES[name]["command"]]
            command = [dask, *here(words)[1:]] if words[0] == "dask" else [*COMMAND, *here(words)[1:]]
            started.append(_started(command, environment, tmp_path / f"{name}.log"))
        url = f"http://127.0.0.1:{ports['8000']}"
        _await(url, tmp_path)
        with Client(url, made.stdout.strip()) as client:
            put_example(client, example_files(tmp_path / "lab"))
            job = client.wait(client.ask("scalings/linear", subject="S01"), 60.0)
            assert job.state is State.DONE
    finally:
        codes = [_stopped(process) for process in reversed(started)]  # who depends on another goes first
    assert codes[0] == 0
    assert -signal.SIGKILL not in codes


def _started(command: list[str], environment: dict[str, str], log: Path) -> subprocess.Popen[bytes]:
    with log.open("wb") as file:
        return subprocess.Popen(command, env=environment, stdout=file, stderr=file, cwd=log.parent)


def _stopped(process: subprocess.Popen[bytes]) -> int:
    """Asked to end as a container is, and forced after a while: its exit code."""
    process.terminate()
    try:
        return process.wait(40)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def _await(url: str, logs: Path) -> None:
    for _ in range(300):
        try:
            if requests.get(f"{url}/ready", timeout=5).status_code == 200:
                return
        except requests.ConnectionError:
            time.sleep(0.1)
    raise AssertionError("\n".join(path.read_text()[-1500:] for path in logs.glob("*.log")))
