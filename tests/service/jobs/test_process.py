"""A runner as a process: started again when it dies, gone when its parent is."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from scaling_service.documents.jobs import State
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.service.jobs.process import EXIT_INPUT, RunnerProcess
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import ServiceSettings
from tests.service.jobs.services import ROOT, ended, until
from tests.service.jobs.test_limits import gone

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


@pytest.fixture
def settings(tmp_path: Path) -> ServiceSettings:
    return ServiceSettings(data_directory=tmp_path / "data", workers=1, lease_s=5.0, reserve_mb=0)


def bones_job(service: Service) -> str:
    """A job that fails with words of its own: the mesh is none."""
    service.put_subject("lab", {"subject": {"id": "S01"}})
    with service.upload("lab", "S01", "femur.stl") as upload:
        upload.write(b"this is no mesh")
        upload.keep()
    return service.ask("lab", "landmarks", {"subject": "S01", "bones": {"femur_r": "femur.stl"}})[0].id


def test_it_is_started_again_and_the_job_is_done(settings: ServiceSettings) -> None:
    service = Service.open(settings)
    process = RunnerProcess(settings)
    process.start()
    try:
        first = process.pid
        assert first is not None
        os.kill(first, signal.SIGKILL)
        until(lambda: process.pid not in (None, first))
        row = ended(service, "lab", bones_job(service))
        assert row.state is State.FAILED
        assert row.failure is not None
        assert (row.failure.file, row.failure.field) == ("S01/femur.stl", "femur_r")
        second = process.pid
    finally:
        process.stop()
        service.close()
    assert process.pid is None
    assert second is not None
    assert gone(second)


PARENT = """
import sys
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.service.jobs.process import RunnerProcess
from scaling_service.service.jobs.settings import ServiceSettings
process = RunnerProcess(ServiceSettings.model_validate_json(sys.argv[1]))
process.start()
print(process.pid, flush=True)
sys.stdin.read()
"""


def test_it_ends_with_its_parent_however_that_ends(settings: ServiceSettings) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, settings.with_secrets()],
        env=ENVIRONMENT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        assert parent.stdout is not None
        runner = int(parent.stdout.readline())
        parent.kill()
    assert gone(runner, within_s=20.0)


def test_alone_it_takes_settings_from_the_environment_and_ends_at_sigterm(tmp_path: Path) -> None:
    environment = ENVIRONMENT | {"SCALING_SERVICE_DATA_DIRECTORY": str(tmp_path / "data")}
    with subprocess.Popen(
        [sys.executable, "-m", "scaling_service.service.jobs"],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        assert '"message": "runner started"' in process.stderr.readline()
        process.terminate()
        assert '"message": "runner stopped"' in process.stderr.read()
        assert process.wait(20) == 0


def test_settings_that_cannot_be_used_are_reported_in_one_line(tmp_path: Path) -> None:
    environment = ENVIRONMENT | {"SCALING_SERVICE_WORKRES": "2"}
    done = subprocess.run(
        [sys.executable, "-m", "scaling_service.service.jobs"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == EXIT_INPUT
    assert "SCALING_SERVICE_WORKRES" in done.stderr
    assert "Traceback" not in done.stderr


FORKED = """
import pickle, runpy, sys
import scaling_service.service.sandbox.warm
import scaling_service.service.sandbox.child
runpy.run_module("scaling_service.service.jobs.__main__", run_name="__mp_main__")
pickle.loads(sys.stdin.buffer.read())
print([name for name in ("sqlalchemy", "fastapi", "uvicorn") if name in sys.modules])
"""


def test_what_computes_loads_nothing_of_the_runner() -> None:
    """It is forked from a process that knows no database, and needs none."""
    calls = pickle.dumps([kind.perform for kind in KINDS.values()])
    reported = subprocess.run(
        [sys.executable, "-c", FORKED], input=calls, capture_output=True, check=True, cwd=ROOT
    )
    assert reported.stdout.strip() == b"[]"
