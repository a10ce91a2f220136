"""The container files: what they run starts here, too, and nothing runs with more rights than it needs."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest
import requests
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scaling_service.client import Client
from scaling_service.documents.jobs import State
from scaling_service.service.jobs import health
from scaling_service.service.jobs.attempts import SLOTS
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
    assert re.fullmatch(r"\d+g", service["mem_limit"])
    assert not {"privileged", "cap_add", "devices", "network_mode", "pid"} & service.keys()
    assert all(port.startswith("127.0.0.1:") for port in service.get("ports", []))
    assert all(volume.partition(":")[0] in COMPOSE["volumes"] for volume in service["volumes"])


def test_every_variable_is_a_setting_and_no_secret_is_written() -> None:
    values = SERVICES["service"]["environment"]
    assert {name.removeprefix(PREFIX).lower() for name in values} <= ServiceSettings.model_fields.keys()
    assert "${POSTGRES_PASSWORD:?" in values[f"{PREFIX}DATABASE_URL"]
    assert "${POSTGRES_PASSWORD:?" in SERVICES["database"]["environment"]["POSTGRES_PASSWORD"]


def test_everything_has_a_health_check() -> None:
    """The service has the image's own."""
    checked = {name: service.get("healthcheck") for name, service in SERVICES.items()}
    assert [name for name, check in checked.items() if check is None] == ["service"]
    assert "HEALTHCHECK" in (FOLDER / "Dockerfile").read_text(encoding="utf-8")
    for service in SERVICES.values():
        for awaited in service.get("depends_on", {}).values():
            assert awaited == {"condition": "service_healthy"}


def test_a_worker_has_threads_for_looks_beside_jobs_and_memory_for_them() -> None:
    worker, command = SERVICES["worker"], SERVICES["worker"]["command"]
    threads = int(command[command.index("--nthreads") + 1])
    jobs = int(SERVICES["service"]["environment"][f"{PREFIX}WORKERS"])
    assert threads * worker["deploy"]["replicas"] >= jobs + SLOTS
    least = (jobs / worker["deploy"]["replicas"] + 2) * ServiceSettings().limit_memory_mb / 1e3
    assert int(worker["mem_limit"].removesuffix("g")) >= least


def test_what_is_installed_is_locked() -> None:
    """Versions of everything, by hashes; what the program needs is among them, and none is too old."""
    project = tomllib.loads((FOLDER.parent / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    wanted = [*project["project"]["dependencies"], *extras["all"]]
    wanted += [line for name in Requirement(wanted[-len(extras["all"])]).extras for line in extras[name]]
    wanted = [line for line in wanted if Requirement(line).name != project["project"]["name"]]
    for lock, names in (("requirements", wanted), ("build", project["build-system"]["requires"])):
        text = (FOLDER / f"{lock}.lock").read_text(encoding="utf-8")
        entries = re.findall(r"^(\S+)==(\S+) \\\n((?: +--hash=sha256:[0-9a-f]{64}(?: \\)?\n)+)", text, re.M)
        assert len(entries) == len(re.findall(r"^\S", text, re.M))
        locked = {canonicalize_name(name): version for name, version, _ in entries}
        for line in names:
            needed = Requirement(line)
            assert locked[canonicalize_name(needed.name)] in needed.specifier, line
    for image in re.findall(r"^FROM (\S+)|image: (postgres\S+)", _read_both(), re.M):
        assert re.fullmatch(r"[a-z]+:\d+\.\d+(\.\d+)?-(slim-)?bookworm", "".join(image)), image


def _read_both() -> str:
    return "\n".join((FOLDER / name).read_text(encoding="utf-8") for name in ("Dockerfile", "compose.yaml"))


def test_only_what_is_copied_is_sent_to_the_builder() -> None:
    """Neither the repository's history, nor passwords, nor recordings that lie about."""
    first, *lines = [
        line
        for line in (FOLDER.parent / ".dockerignore").read_text(encoding="utf-8").splitlines()
        if line and not line.startswith("#")
    ]
    assert first == "*"
    copied = {
        source
        for line in (FOLDER / "Dockerfile").read_text(encoding="utf-8").splitlines()
        if line.startswith("COPY") and "--from" not in line
        for source in line.split()[1:-1]
    }
    assert {line.removeprefix("!") for line in lines if line.startswith("!")} == copied


def test_the_health_check_tells_who_answers() -> None:
    address = f"tcp://127.0.0.1:{free_port()}"
    asked = subprocess.run(
        [sys.executable, "-m", health.__name__, address], capture_output=True, text=True, check=False
    )
    assert (asked.returncode, asked.stderr.split()[:4]) == (1, [address, "does", "not", "answer"])


def test_the_image_copies_what_there_is_and_ends_as_another_user() -> None:
    lines = (FOLDER / "Dockerfile").read_text(encoding="utf-8").splitlines()
    for line in lines:
        if line.startswith("COPY") and "--from" not in line:
            for source in line.split()[1:-1]:
                assert (FOLDER.parent / source).exists(), source
    users = [line.split()[1] for line in lines if line.startswith("USER")]
    assert users[-1] == "1000:1000"
    assert not re.search("latest", "\n".join(lines))


@pytest.mark.costly
def test_what_compose_runs_computes_together(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed")
    dask = shutil.which("dask", path=str(Path(sys.executable).parent))
    assert dask is not None
    ports = {port: str(free_port()) for port in ("8786", "8787", "8000")}

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
        for name in ("scheduler", "worker"):
            words = " ".join(here(SERVICES[name]["healthcheck"]["test"][1:])).split()[1:]
            command = [sys.executable, *(word.replace("$$HOSTNAME", "127.0.0.1") for word in words)]
            checked = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
            assert checked.returncode == 0, (name, checked.stderr)
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
