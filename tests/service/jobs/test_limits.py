"""Bombs go off in their own process only, and nothing is left of a process that ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

import pytest

from scaling_service.service.sandbox.child import Child, Work
from scaling_service.service.sandbox.limits import Limits
from scaling_service.service.sandbox.outcomes import Failed, Finished, Lost, Outcome, Stopped
from scaling_service.service.sandbox.supervisor import supervise
from tests.service.jobs import tasks


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., Outcome]:
    for name in ("inputs", "outputs", "tmp"):
        (tmp_path / name).mkdir()

    def run(work: Work, stop: Callable[[], bool] = lambda: False, **bounds: Any) -> Outcome:
        child = Child(work, tmp_path, Limits(**bounds))
        return supervise(child, stop=stop, progress=lambda _what, _share: None)

    return run


def gone(process: int, within_s: float = 5.0) -> bool:
    """Whether a process ends (or is a zombie that nobody waits for)."""
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        try:
            state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False


def pids(folder: Path) -> list[int]:
    """The numbers that a task wrote, as soon as they are there."""
    file = folder / "outputs" / "pids"
    end = time.monotonic() + 20
    while time.monotonic() < end:
        if file.exists() and (text := file.read_text()).count(" ") == 1:
            return [int(word) for word in text.split()]
        time.sleep(0.02)
    raise AssertionError("the task did not start")


def test_a_result_and_its_files_come_back(run: Callable[..., Outcome], tmp_path: Path) -> None:
    outcome = run(tasks.add)
    assert isinstance(outcome, Finished)
    assert outcome.result == {"sum": 3}
    # printf 3 | sha256sum
    digest = "4e07408562bedb8b60ce05c1decfe3ad16b72230967de01f640b7e4729b49fce"
    assert outcome.files == (("part/sum.txt", digest, 1),)


@pytest.mark.parametrize(
    ("work", "bounds", "setting"),
    [
        (tasks.memory_bomb, {"memory_bytes": 200 << 20}, "limit_memory_mb"),
        (tasks.busy, {"cpu_s": 1.0}, "limit_cpu_s"),
        (tasks.sleep, {"wall_s": 0.5}, "limit_wall_s"),
        (tasks.one_large_file, {"file_bytes": 1 << 20}, "limit_file_mb"),
        (tasks.many_files, {"output_bytes": 1 << 20}, "limit_output_mb"),
    ],
)
def test_a_bomb_is_stopped_by_its_limit(
    run: Callable[..., Outcome], work: Work, bounds: dict[str, Any], setting: str
) -> None:
    begun = time.monotonic()
    outcome = run(work, **bounds)
    assert isinstance(outcome, Failed)
    assert (outcome.failure.kind, outcome.failure.field) == ("LimitExceeded", setting)
    assert outcome.failure.remedy
    assert time.monotonic() - begun < 10.0


def test_an_error_of_the_user_keeps_its_words_without_our_folders(run: Callable[..., Outcome]) -> None:
    outcome = run(tasks.refuse)
    assert isinstance(outcome, Failed)
    assert outcome.failure.model_dump() == {
        "kind": "MarkerMissing",
        "problem": "trial 'walk' has no marker 'RASIS'; it has RKNE",
        "file": "S01/walk.trc",
        "field": "markers.RASIS",
        "remedy": "Map the label that means 'RASIS' under `markers:` in the subject file; if none does, "
        "record it",
    }


def test_a_defect_says_where_but_not_what_stood_in_the_data(run: Callable[..., Outcome]) -> None:
    outcome = run(tasks.broken)
    assert isinstance(outcome, Failed)
    assert outcome.failure.kind == "ProgramError"
    assert "KeyError" in outcome.failure.problem
    assert "tasks.py" in outcome.trace
    assert "tasks.py" not in str(outcome.failure)
    assert "Jones" not in str(outcome)


@pytest.mark.parametrize(
    ("work", "kind"),
    [
        (tasks.crash, Failed),  # by its own fault: it would crash again
        (tasks.killed, Lost),  # from outside: it may be tried again
        (tasks.no_room, Lost),
        (tasks.garbage, Lost),
        (tasks.nan, Failed),
    ],
)
def test_other_ends_are_told_apart(run: Callable[..., Outcome], work: Work, kind: type[Outcome]) -> None:
    assert isinstance(run(work), kind)


def test_nothing_that_a_child_says_is_passed_on_unseen(run: Callable[..., Outcome], tmp_path: Path) -> None:
    seen = list[tuple[str, float]]()
    outcome = supervise(
        Child(tasks.mad_progress, tmp_path, Limits()),
        stop=lambda: False,
        progress=lambda what, share: seen.append((what, share)),
    )
    assert isinstance(outcome, Finished)
    assert seen == [("a b a b a b ", 0.0), ("large", 1.0)]
    failed = run(tasks.mad_failure)
    assert isinstance(failed, Failed)
    assert (failed.failure.kind, failed.failure.problem) == (" ", "a b")


@pytest.mark.parametrize("work", [tasks.mad_name, tasks.mad_result])
def test_an_answer_that_no_program_of_ours_gives_is_none(run: Callable[..., Outcome], work: Work) -> None:
    outcome = run(work)
    assert isinstance(outcome, Lost)
    assert "cannot be read" in outcome.reason


def test_links_are_no_results(run: Callable[..., Outcome]) -> None:
    assert run(tasks.link) == Finished({}, ())


def test_it_stops_when_it_is_asked_to(run: Callable[..., Outcome], tmp_path: Path) -> None:
    marker = tmp_path / "outputs" / "pids"
    assert isinstance(run(tasks.grandchild, stop=marker.exists), Stopped)
    assert all(gone(number) for number in pids(tmp_path))


def test_what_a_child_leaves_running_ends_with_it(run: Callable[..., Outcome]) -> None:
    outcome = run(tasks.abandon)
    assert isinstance(outcome, Finished)
    assert gone(outcome.result["pid"])


def test_children_of_a_child_that_crashed_end_too(run: Callable[..., Outcome], tmp_path: Path) -> None:
    assert isinstance(run(tasks.crash_with_child), Failed)
    assert gone(pids(tmp_path)[1])


def test_secrets_are_not_handed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("outputs", "tmp"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("SCALING_SERVICE_DATABASE_URL", "postgresql://user:secret@/x")
    forkserver._forkserver._stop()  # type: ignore[attr-defined]  # a new one knows what is set now
    child = Child(tasks.environment, tmp_path, Limits())
    outcome = supervise(child, stop=lambda: False, progress=lambda _what, _share: None)
    assert isinstance(outcome, Finished)
    assert outcome.result["ours"] == []
    assert outcome.result["temporary"].endswith("/tmp")


SUPERVISING = """
import sys
from pathlib import Path
from scaling_service.service.sandbox.child import Child
from scaling_service.service.sandbox import supervisor
from scaling_service.service.sandbox.limits import Limits
from scaling_service.service.sandbox.supervisor import supervise
from tests.service.jobs import tasks
supervisor.PRELOAD = "scaling_service.service.sandbox.child"
supervise(Child(tasks.grandchild, Path(sys.argv[1]), Limits()), stop=lambda: False, progress=lambda *_: None)
"""


@pytest.mark.parametrize("victims", [("supervisor",), ("server", "supervisor"), ("server",)])
def test_no_orphan_survives_kill_9(tmp_path: Path, victims: tuple[str, ...]) -> None:
    for name in ("inputs", "outputs", "tmp"):
        (tmp_path / name).mkdir()
    root = Path(__file__).resolve().parents[3]
    supervisor = subprocess.Popen(
        [sys.executable, "-c", SUPERVISING, str(tmp_path)], env={**os.environ, "PYTHONPATH": str(root)}
    )
    with supervisor:
        child, grandchild = pids(tmp_path)
        server = int(Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[1])
        for victim in victims:
            os.kill({"server": server, "supervisor": supervisor.pid}[victim], signal.SIGKILL)
        left = [number for number in (child, grandchild, server) if not gone(number)]
        supervisor.kill()
    assert left == []
