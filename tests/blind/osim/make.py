"""``python -m tests.blind.osim.make --out BANK``: write the bank by OpenSim, going on where it stopped.

Run it with ``tests.blind.run`` and score it with ``tests.blind.score``, as the other bank.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tests.blind.osim.cases import cases, sample
from tests.blind.osim.making import make
from tests.blind.real.angles import data_folder


def main(arguments: list[str] | None = None) -> int:
    """Write the cases that are not there yet."""
    parser = argparse.ArgumentParser(prog="python -m tests.blind.osim.make", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the bank")
    parser.add_argument("--sample", action="store_true", help="six cases only")
    given = parser.parse_args(arguments)
    data = data_folder()
    if data is None:
        parser.error("the real recordings are not here: set SCALING_SERVICE_DATA")
    for case in sample() if given.sample else cases():
        if not (given.out / "labels" / f"{case.id}.json").is_file():
            sys.stdout.write(f"{make(case, given.out, data)} {case.kinds[0]}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
