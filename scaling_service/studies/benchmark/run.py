"""Make every case, have our program and OpenSim answer it, and judge all entries alike."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import abc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from scaling_service.core import errors, progress
from scaling_service.core.text import suggest_name
from scaling_service.documents import writing
from scaling_service.studies.benchmark import parts as benchmark_parts
from scaling_service.studies.benchmark import result as documents
from scaling_service.studies.benchmark.tasks import TASKS

FAILED = "failed.txt"
"""In an answer's folder: why there is none."""

_WRITTEN = "written"

Judged = dict[str, float] | str
"""The metrics of an answer, or why there are none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where a run's files are.

    ``entries``: name to the folder of its answers; ours and OpenSim's lie under ``out``. ``keep``: whether
    what is there is judged as it is.
    """

    data: Path
    out: Path
    entries: abc.Mapping[str, Path]
    keep: bool


def run_benchmark(
    data: Path,
    out: Path,
    *,
    tasks: abc.Collection[str] = (),
    entries: abc.Sequence[Path] = (),
    seed: int = 0,
    keep_answers: bool = False,
    workers: int = 2,
    report: progress.Progress = progress.show_nothing,
) -> documents.BenchmarkDocument:
    """Run tasks and write ``cases``, ``entries`` and ``benchmark.json`` under a folder.

    ``data``: folder of public recordings by name; a task whose data are absent is left out, and said to be.
    ``tasks``: names; all unless given. ``entries``: folders of other programs' answers, called by their
    names.
    ``seed``: of the virtual persons. ``keep_answers``: judge what our program and OpenSim
    answered before, where there is something. ``workers``: cases at a time.
    Raises InputError: a task or entry does not exist. Raises DependencyMissing: OpenSim is not installed.
    """
    if find_spec("opensim") is None:
        raise errors.DependencyMissing(
            "the benchmark reads models and motions by OpenSim, which is not installed",
            field="opensim",
            remedy="Install it with `pip install scaling-service[opensim]`",
        )
    chosen = [_find_task(name) for name in tasks] or list(TASKS.values())
    folders = {name: out / "entries" / name for name in (benchmark_parts.OURS, benchmark_parts.OPENSIM)}
    for entry in entries:
        if not entry.is_dir() or entry.name in folders:
            raise errors.InputError(
                f"'{entry.name}' is no folder, or another entry's name",
                file=entry,
                field="--entry",
                remedy="Name folders of answers (TASK/CASE/files), each with a name of its own",
            )
        folders[entry.name] = entry
    place, start = Place(data=data, out=out, entries=folders, keep=keep_answers), time.monotonic()
    left_out = {task.name: lack for task in chosen if (lack := _find_lack(task, data))}
    ready = [task for task in chosen if task.name not in left_out]
    done = [
        _run_task(task, place, seed, workers, progress.report_part(report, k / len(ready), 1.0 / len(ready)))
        for k, task in enumerate(ready)
    ]
    places = {
        name: float(np.mean([e.place for task in done for e in task.entries if e.entry == name]))
        for name in (folders if done else ())
    }
    document = documents.BenchmarkDocument(
        code_version=writing.code_version(),
        seed=seed,
        tasks=done,
        left_out=left_out,
        places=dict(sorted(places.items(), key=lambda item: item[1])),
        wall_s=time.monotonic() - start,
    )
    out.mkdir(parents=True, exist_ok=True)
    writing.write_json(out / documents.DOCUMENT, document)
    return document


def _find_task(name: str) -> benchmark_parts.Task:
    if name not in TASKS:
        guess = suggest_name(name, TASKS, cutoff=0.5)
        raise errors.InputError(
            f"there is no task '{name}'", field="--tasks", remedy=f"{guess}There are {', '.join(TASKS)}"
        )
    return TASKS[name]


def _find_lack(task: benchmark_parts.Task, data: Path) -> str:
    """Folders of the data that a task needs and that are absent, in words."""
    absent = [name for name in task.needs if not (data / name).exists()]
    return f"{', '.join(absent)} not in {data}" if absent else ""


def _run_task(
    task: benchmark_parts.Task, place: Place, seed: int, workers: int, report: progress.Progress
) -> documents.TaskPart:
    """Answers first, for some judges hold one against OpenSim's; then the judging."""
    start = time.monotonic()
    report(f"{task.name}: making the cases", 0.0)
    inputs = place.out / "cases" / task.name
    inputs.mkdir(parents=True, exist_ok=True)
    cases = task.cases(place.data, inputs, seed)
    asked = [(case, name) for name in (benchmark_parts.OPENSIM, benchmark_parts.OURS) for case in cases]

    def answer(item: tuple[benchmark_parts.Case, str]) -> None:
        case, name = item
        folder = place.entries[name] / task.name / case.name
        if not (place.keep and folder.is_dir()):
            _answer(case, name, folder)

    with ThreadPoolExecutor(workers) as pool:
        for k, ((case, name), _) in enumerate(zip(asked, pool.map(answer, asked), strict=True), 1):
            report(f"{task.name}: {case.name} by {name}", 0.9 * k / len(asked))
        every = [(case, name) for name in place.entries for case in cases]
        found = pool.map(lambda item: _judge(item[0], item[1], place, task), every)
        judged = {(name, case.name): each for (case, name), each in zip(every, found, strict=True)}
    report(f"{task.name}: judged", 1.0)
    return documents.TaskPart(
        name=task.name,
        title=task.title,
        truth=task.truth,
        cases=[case.name for case in cases],
        metrics=[documents.MetricPart(key=m.key, title=m.title, digits=m.digits) for m in task.metrics],
        entries=rank_entries(task, [case.name for case in cases], list(place.entries), judged),
        wall_s=time.monotonic() - start,
    )


def rank_entries(
    task: benchmark_parts.Task,
    cases: abc.Sequence[str],
    names: abc.Sequence[str],
    judged: abc.Mapping[tuple[str, str], Judged],
) -> list[documents.EntryPart]:
    """Every entry's means and mean place, best first; equal figures share a place.

    ``judged``: (entry, case) to metrics or a reason.
    """
    first = task.metrics[0].key
    places: dict[str, list[float]] = {name: [] for name in names}
    for case in cases:
        figures = []
        for name in names:
            found = judged[name, case]
            figures.append(np.inf if isinstance(found, str) else found[first])
        for name, figure in zip(names, figures, strict=True):
            lower, equal = sum(f < figure for f in figures), sum(f == figure for f in figures)
            places[name].append(lower + (equal + 1) / 2)
    parts = []
    for name in names:
        own = {case: found for case in cases if not isinstance(found := judged[name, case], str)}
        keys = [m.key for m in task.metrics if any(m.key in found for found in own.values())]
        parts.append(
            documents.EntryPart(
                entry=name,
                answered=len(own),
                values={
                    key: float(np.mean([found[key] for found in own.values() if key in found]))
                    for key in keys
                },
                place=float(np.mean(places[name])),
                cases=own,
                failures={case: found for case in cases if isinstance(found := judged[name, case], str)},
            )
        )
    return sorted(parts, key=lambda part: part.place)


def _answer(case: benchmark_parts.Case, name: str, folder: Path) -> None:
    """Have an entry answer a case into a folder, which is there once it is done; a failure is noted in it."""
    make = case.ours if name == benchmark_parts.OURS else case.opensim
    if make is None:
        return
    part = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    (part / _WRITTEN).mkdir(parents=True)
    try:
        make(part, partial(_run_program, part / _WRITTEN))
    except (benchmark_parts.ProgramFailed, errors.InputError) as error:
        (part / FAILED).write_text(str(error), encoding="utf-8")
    shutil.rmtree(part / _WRITTEN)
    shutil.rmtree(folder, ignore_errors=True)
    part.replace(folder)


def _judge(case: benchmark_parts.Case, name: str, place: Place, task: benchmark_parts.Task) -> Judged:
    """An entry's metrics of a case, or why there are none."""
    own, opensim = (place.entries[n] / task.name / case.name for n in (name, benchmark_parts.OPENSIM))
    if not own.is_dir():
        return (
            "OpenSim has no tool for it"
            if name == benchmark_parts.OPENSIM and case.opensim is None
            else "no answer"
        )
    if (own / FAILED).is_file():
        return (own / FAILED).read_text(encoding="utf-8")
    try:
        return dict(case.judge(own, opensim))
    except benchmark_parts.NoAnswer as reason:
        return str(reason)


def _run_program(written: Path, words: abc.Sequence[object]) -> Path:
    """Our program as a user runs it, its results in a new folder."""
    out = Path(tempfile.mkdtemp(dir=written)) / "out"
    command = [sys.executable, "-m", "scaling_service", *map(str, words), "--out", str(out)]
    try:
        # The environment of a case: one thread a library, for cases run beside each other.
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            timeout=benchmark_parts.TIME_LIMIT_S,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
    except subprocess.TimeoutExpired:
        raise benchmark_parts.ProgramFailed(f"no answer within {benchmark_parts.TIME_LIMIT_S:g} s") from None
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"exit {done.returncode}"]
        raise benchmark_parts.ProgramFailed(lines[-1])
    return out
