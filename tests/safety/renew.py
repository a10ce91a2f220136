"""Renew snapshots after an intended change: ``python -m tests.safety.renew [case ...]``.

Prints what changed by path, for the changelog. ``--all`` takes costly cases, too; ``--dry`` only prints.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.safety.cases import BY_NAME, CASES
from tests.safety.comparing import compare, tell_differences
from tests.safety.running import find_data, run_case, run_program
from tests.safety.snapshots import load_snapshot, round_numbers, save_snapshot
from tests.safety.surface import SURFACES

MOST_LISTED = 1000


def main(arguments: Sequence[str] | None = None) -> int:
    """Renew the cases named, or all that do not cost much."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("case", nargs="*", metavar="case")
    parser.add_argument("--all", action="store_true", help="costly cases, too")
    parser.add_argument("--dry", action="store_true", help="only print what changed")
    chosen = parser.parse_args(arguments)
    names = chosen.case or [*(c.name for c in CASES if chosen.all or not c.costly), *SURFACES]
    for name in names:
        renew(name, keep=chosen.dry)
    return 0


def renew(name: str, *, keep: bool = False) -> None:
    """Make a snapshot again, and say what changed; with ``keep`` the old one stays."""
    if name in BY_NAME and BY_NAME[name].needs_data and find_data() is None:
        _say(f"== {name}: no recordings; set SCALING_SERVICE_DATA")
        return
    before = load_snapshot(name)
    now = round_numbers(_make(name))
    found = [] if before is None else list(compare(before, now))
    _say(f"== {name}: " + ("new" if before is None else tell_differences(found, MOST_LISTED)))
    if not keep and (before is None or found):
        save_snapshot(name, now)


def _make(name: str) -> object:
    if name in SURFACES:
        return SURFACES[name]()
    with TemporaryDirectory() as folder:
        return run_case(BY_NAME[name], Path(folder) / "case", run_program)


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
