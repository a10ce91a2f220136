"""``python -m tests.blind.make --out BANK --fast|--full``: write the bank, going on where it stopped."""

from __future__ import annotations

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.blind.cases import Case, checks, fast, full, nameable, real_angles
from tests.blind.making import NobodyMeetsError, make
from tests.blind.real.angles import data_folder

UNMET = "unmet"
"""Folder of a bank: kinds of cases that were not made, since nobody meets what could be named."""


def main(arguments: list[str] | None = None) -> int:
    """Write the cases that are not there yet; print how many."""
    parser = argparse.ArgumentParser(prog="python -m tests.blind.make", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the bank")
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--fast", action="store_true", help="one case of each kind")
    which.add_argument("--full", action="store_true", help="every kind, size, movement and seed")
    which.add_argument("--nameable", action="store_true", help="sizes by what people are ordinarily like")
    which.add_argument("--check", action="store_true", help="nothing hidden and no noise")
    parser.add_argument("--seeds", type=int, default=10, help="of the full bank, or of the nameable one")
    parser.add_argument("--first", type=int, default=0, help="seed of the nameable bank")
    parser.add_argument("--nulls", type=int, default=500, help="of the full bank")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args(arguments)
    cases = _chosen(given)
    subjects, labels = given.out / "subjects", given.out / "labels"
    # The label is written last: a case without one was not finished.
    done = {file.stem for folder in (labels, given.out / UNMET) for file in folder.glob("*.json")}
    missing = [c for c in cases if c.id not in done]
    with ProcessPoolExecutor(given.workers) as pool:
        n = len(missing)
        made = pool.map(_make_or_note, missing, [subjects] * n, [labels] * n, chunksize=4)
        for k, _ in enumerate(made, start=1):
            if k % 50 == 0 or k == n:
                sys.stdout.write(f"{k} of {n} cases written\n")
    sys.stdout.write(f"{len(cases)} cases in {given.out}\n")
    return 0


def _make_or_note(case: Case, subjects: Path, labels: Path) -> None:
    """Write a case, or that nobody meets one of that kind that could be named."""
    try:
        make(case, subjects, labels)
    except NobodyMeetsError:
        noted = labels.parent / UNMET / f"{case.id}.json"
        noted.parent.mkdir(parents=True, exist_ok=True)
        noted.write_text(json.dumps(case.kinds), encoding="utf-8")


def _chosen(given: argparse.Namespace) -> list[Case]:
    if given.fast:
        return fast()
    if given.check:
        return checks()
    if given.nameable:
        return nameable(given.seeds, given.first)
    real = real_angles() if data_folder() else []
    return [*full(given.seeds, given.nulls), *real]


if __name__ == "__main__":
    raise SystemExit(main())
