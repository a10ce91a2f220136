"""``python -m tests.blind.run --bank BANK --out RESULTS``: let the product look for what is hidden.

Runs the product's command line, as an outsider, on every subject folder. The labels are never passed on.
Cases that have a result, or failed before (``failed.txt``), are not run again.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import scaling_service

_SEARCH = ("capabilities", "core", "files", "model", "numerics", "recording")
"""Packages that decide what is found with a model that is scaled already."""

TIMEOUT_S = 900.0
"""Chosen: three times what a full body with forces may take."""


def main(arguments: list[str] | None = None) -> int:
    """Run what has no result yet; print each case's outcome."""
    parser = argparse.ArgumentParser(prog="python -m tests.blind.run", description=__doc__)
    parser.add_argument("--bank", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--start", default="none", help="none: the given model is already scaled")
    parser.add_argument("--again", action="store_true", help="try the failed ones again")
    given = parser.parse_args(arguments)
    subjects = sorted((given.bank / "subjects").glob("*/subject.yaml"))
    waiting = [s for s in subjects if not _done(given.out / s.parent.name, again=given.again)]
    sys.stdout.write(f"{len(subjects)} cases, {len(waiting)} to run\n")
    command, code = [sys.executable, "-m", "scaling_service", "discover"], fingerprint()
    with ThreadPoolExecutor(given.workers) as pool:
        jobs = [
            pool.submit(run_one, command, s, given.out / s.parent.name, given.start, code) for s in waiting
        ]
        for k, (subject, job) in enumerate(zip(waiting, jobs, strict=True), start=1):
            sys.stdout.write(f"{k}/{len(waiting)} {subject.parent.name} {job.result()}\n")
            sys.stdout.flush()
    return 0


def fingerprint() -> str:
    """Eight letters that change with the code of the search and what it stands on."""
    package = Path(scaling_service.__path__[0])
    files = sorted(f for part in _SEARCH for f in (package / part).rglob("*.py"))
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:8]


def run_one(command: Sequence[str], subject: Path, out: Path, start: str, code: str = "") -> str:
    """Run one case; leaves ``discovery.json``, or ``failed.txt`` with what the program said.

    Returns
    -------
    str
        What became of it, and the seconds that it took.
    """
    out.mkdir(parents=True, exist_ok=True)
    (out / "code.txt").write_text(f"{code}\n", encoding="utf-8")
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    begun = time.monotonic()
    try:
        done = subprocess.run(
            [*command, str(subject), "--start", start, "--out", str(out)],
            capture_output=True, text=True, timeout=TIMEOUT_S, env=environment, check=False,
        )  # fmt: skip
        said = "" if done.returncode == 0 else f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    except subprocess.TimeoutExpired:
        said = f"longer than {TIMEOUT_S:g} s"
    seconds = time.monotonic() - begun
    (out / "seconds.txt").write_text(f"{seconds:.2f}\n", encoding="utf-8")
    if said or not (out / "discovery.json").is_file():
        (out / "failed.txt").write_text(said or "no discovery.json was written", encoding="utf-8")
        return f"failed after {seconds:.1f} s"
    (out / "failed.txt").unlink(missing_ok=True)
    return f"done in {seconds:.1f} s"


def _done(out: Path, *, again: bool) -> bool:
    return (out / "discovery.json").is_file() or (not again and (out / "failed.txt").is_file())


if __name__ == "__main__":
    raise SystemExit(main())
