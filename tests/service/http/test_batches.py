"""A batch over HTTP goes on where it was, whoever is killed when; what is done is not done again."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from scaling_service.client import Client, JobEnded
from scaling_service.documents.jobs import State
from tests.cli.serving import ENVIRONMENT
from tests.jobs.laboratory import laboratory
from tests.service.http.served import Served, serving, settings_in
from tests.service.http.test_numbers import put, untimed
from tests.service.http.tormented import finished, tormented
from tests.service.jobs.services import running, until
from tests.service.jobs.wholes import WHOLES
from tests.service.store.postgres import server

PEOPLE = 4


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The database of the servers that are started."""
    if request.param == "postgresql":
        monkeypatch.setitem(ENVIRONMENT, "SCALING_SERVICE_DATABASE_URL", server().new_database())
    return str(request.param)


def killed_batch(folder: Path, n_members: int, n_kills: int, seconds: float) -> str:
    """Ask for a batch, and kill one process after another; what was seen, for a report."""
    kept: dict[str, tuple[object, ...]] = {}
    with tormented(folder, seed=5) as service:
        with Client(service.url) as client:
            batch = client.ask("whole", numbers=list(range(n_members)), seconds=seconds, failing=[3]).id
        for _ in range(n_kills):
            service.kill_one((0.0, 2 * seconds))
            with Client(service.url) as client:
                kept |= {job: how for job, how in finished(client, kind="part").items() if job not in kept}
        with Client(service.url, patience_s=60.0) as client:
            state = client.job(batch).state
            assert client.wait(batch, 300.0).state is State.DONE
            result = client.result(batch)
            members = list(client.jobs(kind="part"))
            after = finished(client, kind="part")
        assert {job: after[job] for job in kept} == kept  # the same process, attempt and moment
    assert result == {
        "sum": sum(k**2 for k in range(n_members) if k != 3),
        "numbers": list(range(n_members)),
        "failed": [3],
    }
    assert len(members) == n_members
    begun = sum(member.attempt for member in members)
    return (
        f"{n_members} members, killed {dict(service.killed)}: {len(kept)} were done before the last kill, "
        f"each computed once; {begun} attempts in all; the batch was {state} after the last kill\n"
    )


@pytest.mark.benchmark
def test_killed_50_times_during_a_batch_of_100(tmp_path: Path, database: str) -> None:
    sys.stdout.write(f"{database}: {killed_batch(tmp_path / 'data', 100, 50, 0.5)}")


def test_progress_counts_members_and_cancelling_ends_them_all(tmp_path: Path) -> None:
    with serving(settings_in(tmp_path), WHOLES) as served, served.client() as client:
        batch = client.ask("whole", numbers=[1, 2, 3], seconds=0.3)
        assert (batch.state, batch.progress.what) == (State.WAITING, "0 of 3 ended")
        with running(served.service):
            seen = {job.progress.what for job in client.events(batch)}
            assert seen >= {"0 of 3 ended", "2 of 3 ended", "done"}
            long = client.ask("whole", numbers=[4, 5, 6], seconds=60.0)
            until(lambda: list(client.jobs(state="running")))
            (member, *_) = client.jobs(kind="part", state="running")
            refused = served.call("DELETE", f"/v1/jobs/{member.id}")
            assert (refused.status_code, refused.json()["field"]) == (409, "job")
            assert client.cancel(long).state is State.CANCELLED
            until(lambda: len(list(client.jobs(state="cancelled"))) == 4, within_s=5.0)
            with pytest.raises(JobEnded, match="cancelled"):
                client.wait(long)
            client.delete(long)
            assert list(client.jobs(state="cancelled")) == []


def cohort(client: Client, folder: Path, number: int) -> list[str]:
    """People of one laboratory, uploaded; the second one's recording is damaged."""
    document = yaml.safe_load(laboratory(folder).read_text())
    (folder / "bad.trc").write_text("no recording")
    names = []
    for k in range(number):
        file = folder / f"P{k:02}.yaml"
        trials = document["trials"] | ({"calibration": ["bad.trc"]} if k == 1 else {})
        changed = {"subject": {"id": file.stem, "mass_kg": 60.0 + k}, "trials": trials}
        file.write_text(yaml.safe_dump(document | changed))
        names.append(put(client, folder, file))
    return names


def scaled(served: Served, folder: Path) -> Any:
    """A batch that is disturbed by nobody."""
    client = served.client()
    names = cohort(client, folder, PEOPLE)
    with running(served.service):
        job = client.wait(client.ask("batches", subjects=names, methods=["MB"]))
    return client.result(job)


def more_than(number: int, client: Client) -> dict[str, tuple[object, ...]]:
    """The members that are done, as soon as there are more of them."""
    while len(done := finished(client, kind="batch-member")) <= number:
        time.sleep(0.1)
    return done


@pytest.mark.parametrize(
    "victims",
    [
        pytest.param(("server",), marks=pytest.mark.costly),  # waits for two cohorts
        pytest.param(("child", "runner", "server"), marks=pytest.mark.benchmark),
    ],
)
def test_people_scaled_by_a_service_that_is_killed(victims: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "files").mkdir()
    with serving(settings_in(tmp_path / "quiet")) as served:
        undisturbed = scaled(served, tmp_path / "files")
    ended = [entry["status"] for entry in undisturbed["subjects"]]
    assert ended == ["done", "failed", *(PEOPLE - 2) * ["done"]]
    kept: dict[str, tuple[object, ...]] = {}
    with tormented(tmp_path / "data", seed=1) as service:
        with Client(service.url) as client:
            names = cohort(client, tmp_path / "files", PEOPLE)
            batch = client.ask("batches", subjects=names, methods=["MB"]).id
        for victim in victims:
            with Client(service.url, patience_s=60.0) as client:
                kept |= more_than(len(kept), client)
            service.kill(victim)
        with Client(service.url, patience_s=60.0) as client:
            client.wait(batch, 120.0)
            assert json.dumps(untimed(client.result(batch))) == json.dumps(untimed(undisturbed))
            after = finished(client, kind="batch-member")
            made = {file.name for file in client.files(batch)}
    assert len(kept) >= len(victims)
    assert {job: after[job] for job in kept} == kept  # what was done is not done again
    assert made >= {"P00/MB/model.json", "P02/comparison.json", "cohort.json", "report.html"}
