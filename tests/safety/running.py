"""Run a case by the command line, in a folder of its own, and read what it wrote and said."""

from __future__ import annotations

import os
import resource
import shlex
import subprocess
import sys
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.safety.cases import DATA, Case
from tests.safety.reading import read_folder
from tests.safety.sentences import sort_sentences, split_screen

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
THREADS = os.environ.get("SAFETY_THREADS", "1")
"""Threads of numerical libraries. Snapshots are of 1; others show which numbers depend on it."""

SCREEN = {"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}
"""Wide, without colours."""


def find_data() -> Path | None:
    """The folder of the real recordings, where there is one."""
    named = os.environ.get("SCALING_SERVICE_DATA")
    folder = Path(named) if named else ROOT.parent / "shared" / "data"
    return folder.resolve() if folder.is_dir() else None


def run_case(case: Case, folder: Path, run: Callable[[list[str], Path], str]) -> dict[str, Any]:
    """All that a case wrote and said, as a document: numbers of files under their names, and sentences.

    ``run`` gives what the program prints, such as :func:`run_program`.
    """
    data = find_data()
    folder = folder.resolve()
    prepare_folder(case, folder, data)
    there = set(folder.rglob("*"))
    said: dict[str, Any] = {}
    replaced = {str(folder): "."} | ({str(data): "DATA"} if data else {})
    for command in case.commands:
        words = shlex.split(command.replace(DATA, str(data)))
        said[words[0]] = sort_sentences(split_screen(run(words, folder)), replaced)
    written = sorted(path for path in set(folder.rglob("*")) - there if path.is_file())
    return {"screen": said} | read_folder(folder, written, replaced)


def prepare_folder(case: Case, folder: Path, data: Path | None) -> None:
    """The case's subject and documents as files."""
    folder.mkdir(parents=True, exist_ok=True)
    if case.subject is not None:
        unpack_subject(case.subject, folder)
    for name, text in case.documents.items():
        (folder / name).write_text(text.replace(DATA, str(data)), encoding="utf-8")


def unpack_subject(name: str, folder: Path) -> None:
    """A packed subject's recordings and documents."""
    with tarfile.open(HERE / "subjects" / f"{name}.tar.gz") as packed:
        packed.extractall(folder, filter="data")


def program_environment() -> dict[str, str]:
    """Of a program started by a test: this code, few threads, a wide screen without colours."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), THREADS)
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    return dict(os.environ) | threads | SCREEN | {"PYTHONPATH": path}


def run_program(arguments: list[str], folder: Path) -> str:
    """What the program prints; a failure is raised with what it says. ``SAFETY_TIMES=1`` tells its time."""
    began = spent_by_programs()
    done = subprocess.run(
        [sys.executable, "-m", "scaling_service", *arguments],
        cwd=folder,
        env=program_environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{shlex.join(arguments)}: {done.returncode}\n{done.stdout}\n{done.stderr}"
    if "SAFETY_TIMES" in os.environ:
        sys.stderr.write(f"{spent_by_programs() - began:6.1f} s  {shlex.join(arguments)[:90]}\n")
    return done.stdout


def spent_by_programs() -> float:
    """Processor seconds of all programs that have ended."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime
