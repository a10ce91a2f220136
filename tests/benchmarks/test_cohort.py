"""27 persons and 2.4 million frames: a batch of a service whose processes are killed, and one on Dask.

Run with ``pytest -m benchmark -s tests/benchmarks/test_cohort.py``; ``COHORT_STRIDES=39`` is a tenth of it.
"""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from scaling_service.cli import main
from scaling_service.documents.jobs import State
from scaling_service.service.jobs.kinds import KINDS
from scaling_service.service.jobs.service import Service, open_store
from scaling_service.service.jobs.settings import ServiceSettings
from tests.service.http.served import settings_in
from tests.service.http.test_numbers import untimed
from tests.service.jobs.services import ROOT, until
from tests.service.jobs.test_kill import at_work, processes

pytestmark = pytest.mark.benchmark

PERSONS, KILLS = 27, 20
STRIDES = float(os.environ.get("COHORT_STRIDES", "390"))
MOST_S, MOST_MIB = 900.0, 1024.0  # s on two cores, and of each process
_CLOCK = os.sysconf("SC_CLK_TCK")
_TIMES = re.compile(rb">\d+\.\d\d?<")  # cells of reports; other numbers in them stand in documents, too
_HELD = re.compile(rb'<script type="application/json" id="held">(.*?)</script>')  # what a report's views show


@pytest.fixture(scope="module")
def cohort(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The folders of the persons."""
    folder = tmp_path_factory.mktemp("cohort") / "persons"
    given = ["--persons", str(PERSONS), "--strides", str(STRIDES), "--out", str(folder)]
    assert main(["example", *given]) == 0
    return sorted(folder.iterdir())


class Usage(threading.Thread):
    """Processor time and memory of all processes below this one, looked at twice a second."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.cpu_s, self.mib = dict[tuple[int, str], float](), dict[tuple[int, str], float]()
        self._over = threading.Event()

    def run(self) -> None:
        below = {os.getpid()}
        while not self._over.wait(0.5):
            found = dict[int, tuple[int, str, float]]()
            for entry in Path("/proc").glob("[0-9]*"):
                with suppress(OSError):
                    fields = (entry / "stat").read_text().rpartition(")")[2].split()
                    seconds = (int(fields[11]) + int(fields[12])) / _CLOCK
                    found[int(entry.name)] = int(fields[1]), fields[19], seconds
            below = {os.getpid()} | {number for number in below if number in found}  # orphans, too
            while more := {number for number, (parent, *_) in found.items() if parent in below} - below:
                below |= more
            for number in below - {os.getpid()}:
                self._note(number, *found[number][1:])

    def _note(self, number: int, started: str, seconds: float) -> None:
        self.cpu_s[number, started] = seconds
        with suppress(OSError):
            reported = re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{number}/status").read_text())
            self.mib[number, started] = int(reported[1]) / 1024 if reported else 0.0

    def stop(self) -> None:
        self._over.set()
        self.join()


@contextmanager
def runner(settings: ServiceSettings, log: Path) -> Iterator[Callable[[], subprocess.Popen[bytes]]]:
    """What starts a runner, again where it was killed; the last one ends with the block."""
    started = list[subprocess.Popen[bytes]]()

    def start() -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "scaling_service.service.jobs", "--from-parent"]
        with log.open("ab") as file:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=file, cwd=ROOT)
        assert process.stdin is not None
        process.stdin.write(settings.with_secrets().encode() + b"\n")
        process.stdin.flush()
        started.append(process)
        return process

    try:
        yield start
    finally:
        for process in started:
            assert process.stdin is not None
            process.stdin.close()
            process.wait(60)


def compute(cohort: list[Path], settings: ServiceSettings, kills: int, log: Path) -> dict[str, Any]:
    """What the batch made, by path, without times; that each person was scaled once is checked."""
    service, usage, draw = Service(open_store(settings), settings, KINDS), Usage(), random.Random(1)
    names = [put(service, person) for person in cohort]
    usage.start()
    begun = time.monotonic()
    whole = service.ask("lab", "batch", {"subjects": names})[0].id
    with runner(settings, log) as start:
        process = start()
        for _ in range(kills):
            at_work(service, process.pid)
            time.sleep(draw.uniform(0.0, STRIDES / 20.0))
            victim, _what = draw.choice(processes(process.pid))
            with suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)
            if victim == process.pid:
                process.wait()
                process = start()
        until(lambda: service.job("lab", whole).state.is_over, within_s=4 * 3600.0)
        wall_s = time.monotonic() - begun
        usage.stop()
    rows = [service.job("lab", job.id) for job in service.jobs("lab", limit=100).items]
    assert [row.state for row in rows] == [State.DONE] * (PERSONS + 1)
    losses = sum(row.losses for row in rows)
    assert all(row.attempt == row.losses + 1 for row in rows), "something was computed twice"
    most, cpu_s = max(usage.mib.values()), sum(usage.cpu_s.values())
    sys.stdout.write(
        f"\n{PERSONS} persons, {STRIDES:g} strides a walk, {kills} kills, {losses} attempts lost: "
        f"{wall_s:.0f} s, {cpu_s:.0f} s of CPU, {most:.0f} MiB a process at most, "
        f"load of the machine {os.getloadavg()[0]:.1f}\n"
    )
    assert most <= MOST_MIB
    assert cpu_s <= 2 * MOST_S  # what two cores have in that time
    blobs = service.store.blobs
    made = {file.name: content(blobs.path(file.sha256)) for file in service.files("lab", whole)}
    service.close()
    return made


def put(service: Service, person: Path) -> str:
    """Upload a person; the subject's name."""
    document = json.loads((person / "subject.json").read_text())
    service.put_subject("lab", document)
    for file in person.glob("*.trc"):
        with service.upload("lab", person.name, file.name) as upload:
            upload.write(file.read_bytes())
            upload.keep()
    return person.name


def content(file: Path) -> Any:
    """Of a file that was made; without times, which two runs do not share."""
    raw = file.read_bytes()
    with suppress(ValueError):
        return untimed(json.loads(raw))
    if not raw.startswith(b"<!"):
        return hash(raw)
    held = [untimed(json.loads(document)) for document in _HELD.findall(raw)]
    return held, hash(_TIMES.sub(b"><", _HELD.sub(b"", raw)))


def test_kills_and_a_cluster_change_nothing(cohort: list[Path], tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    alone = settings_in(tmp_path / "alone", most_losses=KILLS)
    killed = compute(cohort, alone, KILLS, tmp_path / "log")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        shared = settings_in(tmp_path / "shared", dask_address=cluster.scheduler_address)
        clustered = compute(cohort, shared, 0, tmp_path / "log")
    assert len(killed) > 10 * PERSONS
    assert [path for path, made in killed.items() if made != clustered.get(path)] == []
    assert killed.keys() == clustered.keys()
