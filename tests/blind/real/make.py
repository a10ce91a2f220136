"""``python -m tests.blind.real.make --out BANK [--bones]``: the real recordings with something hidden."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from pathlib import Path

from scaling_service.files.sto import Table, write_sto
from tests.blind.real.angles import data_folder
from tests.blind.real.hiding import CASES, RealCase
from tests.blind.real.squats import PERSON, read_squats, write_subject
from tests.blind.real.walking import NAME, make_walking


def main(arguments: list[str] | None = None) -> int:
    """Write the cases; without the recordings say so and fail."""
    parser = argparse.ArgumentParser(prog="python -m tests.blind.real.make", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the bank")
    parser.add_argument(
        "--bones",
        action="store_true",
        help="the person with imaged bones instead; to be run with --start EB_am",
    )
    given = parser.parse_args(arguments)
    data = data_folder()
    if data is None:
        sys.stderr.write("the real recordings are not here: set SCALING_SERVICE_DATA\n")
        return 2
    if given.bones:
        sys.stdout.write(f"{make_walking(data, given.out)} {NAME}\n")
        return 0
    for case in CASES:
        make_real(case, data, given.out)
        sys.stdout.write(f"{case_id(case)} {case.name}\n")
    return 0


def case_id(case: RealCase) -> str:
    """A name that tells nothing."""
    return "real_" + hashlib.sha256(case.name.encode()).hexdigest()[:10]


def make_real(case: RealCase, data: Path, out: Path) -> Path:
    """Write one case's folder and its label; gives the subject file."""
    recorded = read_squats(data)
    trials = [case.change(trial, k) for k, trial in enumerate(recorded)]
    subject = write_subject(out / "subjects" / case_id(case), data, trials)
    labels = out / "labels"
    labels.mkdir(parents=True, exist_ok=True)
    names = [t.markers.name for t in trials]
    truth = {
        "id": case_id(case),
        "group": "real",
        "kinds": [case.name],
        "size": "real",
        "movement": "squat",
        "forces": True,
        "c3d": False,
        "real": True,
        "seed": 0,
        "body_mass_kg": PERSON["mass_kg"],
        "hidden": list(case.hidden),
        "calibration": names[:-1],
        "evaluation": names[-1:],
        **case.also,
    }
    (labels / f"{case_id(case)}.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
    if "compare_force" in case.also:
        (labels / case_id(case)).mkdir(exist_ok=True)
        for trial in recorded:
            vertical = trial.plate(case.also["compare_force"]["plate"], "v")[1]
            withheld = Table(
                name=trial.markers.name,
                columns=("time", "fy"),
                data=trial.forces.data[:, [0, vertical]],
                in_degrees=False,
            )
            write_sto(labels / case_id(case) / f"{trial.markers.name}.sto", withheld)
    return subject


if __name__ == "__main__":
    raise SystemExit(main())
