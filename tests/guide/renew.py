"""``python -m tests.guide.renew [NAME…]``: measure the guide's figures again, and write ``figures.json``.

They run the program, for minutes: the papers' studies anywhere, ``pins``, ``clinic`` and ``image`` on the
real recordings.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from scaling_service.files.sto import read_sto
from scaling_service.guide.pages import FIGURES
from scaling_service.report.tables import Table, to_cell
from scaling_service.studies.benchmark.document import DOCUMENT, BenchmarkDocument, make_tables, read_document
from scaling_service.studies.benchmark.parts import OURS
from scaling_service.studies.benchmark.tasks.living_bone import (
    measure_angle_error_deg,
    measure_coverage,
    read_bones,
)
from tests.oracle.coverage import measure
from tests.safety.running import find_data, run_program

ROOT = Path(__file__).resolve().parents[2]
LENGTHS = {"femur_r": "RFemurLength", "femur_l": "LFemurLength", "shank_r": "RTibiaLength"}
LENGTHS |= {"shank_l": "LTibiaLength"}
"""Our name of a length to the one in a clinic's files."""

PAPERS = ("puchaud2019", "muller2017", "futamure")
SAMPLES = 40
"""For each level of noise in the study of Muller 2017: minutes, where the paper's 1000 take hours."""

PERSONS = 40
"""Virtual persons of the oracle: a length's coverage is known to 4 % then, minutes."""

SETS = {
    "cadaver_hip": "hip circles of a cadaver, pins",
    "knee_fluoroscopy": "step up, fluoroscopy",
    "knee_pins": "walking, pins",
    "shoulder_pins": "eating, pins",
}
"""Recordings over bones of known pose, and what was held out."""


def measure_pins() -> dict[str, Any]:
    """Bones' errors before and after ``discover``, on recordings that it did not fit, and coverage."""
    rows, ratios, coverage = [], [], []
    for name, what in SETS.items():
        with tempfile.TemporaryDirectory() as scratch:
            box, out = _data("living_bone") / name, Path(scratch)
            _run("discover", box / "subject.yaml", "--start", "none", "--no-report", "--out", out / "found")
            verdict = json.loads((out / "found" / "discovery.json").read_text(encoding="utf-8"))
            kinds = sorted({effect["kind"].replace("_", " ") for effect in verdict["effects"]})
            subject = yaml.safe_load((box / "subject.yaml").read_text(encoding="utf-8"))
            trial = Path(subject["trials"]["evaluation"][0]).stem
            true = read_bones(box / f"{trial}_bones.csv")
            errors = []
            for model, folder in ((box / "model.osim", "before"), (out / "found" / "model.json", "after")):
                _run("ik", model, box / f"{trial}.trc", "--poses", "--out", out / folder)
                poses = read_poses(out / folder / f"{trial}_poses.sto", list(true))
                errors.append(measure_angle_error_deg(poses, true))
            motions = [out / "before" / f"{trial}_ik{kind}.mot" for kind in ("", "_sd")]
            covered = measure_coverage(*motions, true)
        ratios.append(errors[1] / errors[0])
        coverage.append(covered)
        named = ", ".join(kinds) or verdict["verdict"]
        rows.append(
            [what, named, f"{errors[0]:.1f}", f"{errors[1]:.1f}", f"{ratios[-1]:.2f}", f"{covered:.0%}"]
        )
    return {
        "ratio": float(np.exp(np.mean(np.log(ratios)))),
        "worst": max(ratios),
        "least_covered": min(coverage),
        "most_covered": max(coverage),
        "table": {
            "columns": [
                "held-out recording",
                "named",
                "error before, deg",
                "after, deg",
                "after / before",
                "95 % intervals hold",
            ],
            "rows": rows,
        },
    }


def read_poses(file: Path, bones: Sequence[str]) -> dict[str, np.ndarray]:
    """Found rotation of every bone in every frame, (n, 3, 3), from ``--poses``."""
    table = read_sto(file)
    found = {}
    for bone in bones:
        angles = np.column_stack([table.column(f"{bone}_O{axis}") for axis in "xyz"])
        found[bone] = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
    return found


def measure_persons() -> dict[str, Any]:
    """Errors and intervals of each method on virtual persons drawn by the tests' own code."""
    found = measure(range(300, 300 + PERSONS), ["MB", "MB_lam", "MB_am", "MAP"])
    rows = [
        [
            method if k == 0 else "",
            name.replace("_", " "),
            f"{errors.rms:.1f}",
            "not stated" if np.isnan(errors.stated) else f"{errors.stated:.1f}",
            *("–" if np.isnan(errors.stated) else f"{errors.cover(part):.0%}" for part in (50, 80, 95)),
        ]
        for method, quantities in found.items()
        for k, (name, errors) in enumerate(sorted(quantities.items()))
        if not (name.endswith(" mean") and np.isnan(errors.stated))
    ]
    columns = ["method", "mm or deg", "RMS error", "stated", "50 % intervals hold", "80 %", "95 %"]
    return {"persons": PERSONS, "table": {"columns": columns, "rows": rows}}


def measure_clinic() -> dict[str, Any]:
    """Lengths of children with the conventional markers, against their laboratory's software."""
    rows, worst = [], []
    children = sorted(p for p in _data("clinic").iterdir() if p.is_dir())
    for k, child in enumerate(children, 1):
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / child.name
            folder.mkdir()
            for file in child.glob("*.c3d"):
                shutil.copy(file, folder)
            _run("proof", folder, "--out", Path(scratch) / "looked")
            subject = Path(scratch) / "looked" / "subject.yaml"
            _run("scale", subject, "--method", "MB", "--out", Path(scratch) / "out")
            scaled = json.loads((Path(scratch) / "out" / "MB" / "scaling.json").read_text(encoding="utf-8"))
        theirs = next(iter(json.loads((child / "sizes.json").read_text(encoding="utf-8")).values()))
        ours = scaled["segment_lengths_mm"]
        off = {n: 100.0 * (ours[n] / theirs[key] - 1.0) for n, key in LENGTHS.items() if key in theirs}
        worst.append(max(map(abs, off.values())))
        rows.append([f"child {k}", *(f"{off[n]:+.1f}" if n in off else "–" for n in LENGTHS)])
    columns = ["", *(f"{name.replace('_r', ', right').replace('_l', ', left')}, %" for name in LENGTHS)]
    return {
        "children": len(children),
        "median": float(np.median(worst)),
        "largest": max(worst),
        "table": {"columns": columns, "rows": rows},
    }


def measure_image() -> dict[str, Any]:
    """All methods on the person with bones from magnetic resonance: errors held out, and lengths."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = _data("jia_mri")
        document = {
            "subject": {"id": "jia", "height_m": 1.62, "mass_kg": 63.0},
            "model": "lower_limb_14dof",
            "extra_markers": {
                f"{side}{label}": f"{segment}_{side.lower()}"
                for side in "RL"
                for label, segment in (("THI", "femur"), ("TUB", "tibia"), ("SHN", "tibia"))
            },
            "trials": {
                "static": str(folder / "Static.c3d"),
                "calibration": [str(folder / "Walking02.c3d")],
                "evaluation": [str(folder / "Walking01.c3d")],
            },
            "bones": {"units": "mm"}
            | {n: str(next(folder.rglob(f"{n}*.stl"))) for n in ("pelvis", "femur_r", "tibia_r")},
            "image_markers": str(folder / "image_markers.csv"),
        }
        file = Path(scratch) / "subject.yaml"
        file.write_text(yaml.safe_dump(document), encoding="utf-8")
        _run("compare", file, "--no-report", "--out", Path(scratch) / "out")
        found = json.loads((Path(scratch) / "out" / "comparison.json").read_text(encoding="utf-8"))
    methods = found["methods"]
    methods = methods if isinstance(methods, dict) else {m["method"]: m for m in methods}
    rows = [
        [
            name,
            f"{entry['kinematic_error_mm']['Walking01']['mean']:.1f}",
            *(f"{entry['segment_lengths_mm'][length]:.0f}" for length in ("inter_hip", "femur_r", "shank_r")),
        ]
        for name, entry in methods.items()
    ]
    columns = ["method", "held-out error, mm", "inter hip, mm", "femur, right, mm", "shank, right, mm"]
    return {"table": {"columns": columns, "rows": rows}, "verdict": found["verdict"]["headline"]}


def measure_study(paper: str) -> dict[str, Any]:
    """Every claim of a paper: theirs beside ours."""
    with tempfile.TemporaryDirectory() as scratch:
        _run("reproduce", paper, "--samples", SAMPLES, "--workers", 1, "--out", scratch)
        study = json.loads((Path(scratch) / "study.json").read_text(encoding="utf-8"))
    words = {True: "holds", False: "does not hold", None: "undecided"}
    claims = study["claims"]
    return {
        "claims": len(claims),
        "hold": sum(claim["holds"] is True for claim in claims),
        "samples": SAMPLES,
        "table": {
            "columns": ["claim", "in the paper", "here", ""],
            "rows": [[c["claim"], c["paper"], c["ours"], words[c["holds"]]] for c in claims],
        },
    }


def measure_benchmark() -> dict[str, Any]:
    """Every task's table, and the whole, from one run on the real recordings."""
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "judged"
        _run("benchmark", "--data", _data(""), "--out", out)
        return describe_benchmark(read_document(out / DOCUMENT))


def describe_benchmark(document: BenchmarkDocument) -> dict[str, Any]:
    """The tables of a run as the guide shows them, and where our program failed."""
    names = [*(task.name for task in document.tasks), "whole"]
    tables = dict(zip(names, map(_describe_table, make_tables(document)), strict=True))
    ours = {task.name: next(e for e in task.entries if e.entry == OURS) for task in document.tasks}
    failed = [
        f"{name}: {case.replace('_', ' ')}"
        for name, entry in ours.items()
        for case in (*entry.failures, *(c for c, found in entry.cases.items() if found.get("wrong")))
    ]
    behind = [t.title for t in document.tasks if ours[t.name].place > min(e.place for e in t.entries)]
    minutes = document.wall_s / 60.0
    return {
        **tables,
        "minutes": minutes,
        "failed": "; ".join(failed) or "none",
        "behind": "; ".join(behind) or "none",
    }


def _describe_table(table: Table) -> dict[str, Any]:
    """A table without tones."""
    rows = [[to_cell(cell).text for cell in (row.header, *row.cells)] for row in table.rows]
    return {"columns": list(table.columns), "rows": rows}


MEASURES: Mapping[str, Callable[[], dict[str, Any]]] = {
    **{paper: partial(measure_study, paper) for paper in PAPERS},
    "pins": measure_pins,
    "clinic": measure_clinic,
    "image": measure_image,
    "persons": measure_persons,
    "benchmark": measure_benchmark,
}


def _data(name: str) -> Path:
    data = find_data()
    if data is None:
        raise SystemExit("the real recordings are not here: set SCALING_SERVICE_DATA")
    return data / name


def _run(*words: object) -> None:
    run_program([str(word) for word in words], ROOT)


def write_figure(name: str, measured: dict[str, Any]) -> None:
    """Put what was measured under its name into ``figures.json``."""
    figures = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else {}
    figures = dict(sorted({**figures, name: measured}.items()))
    FIGURES.write_text(json.dumps(figures, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def main(names: list[str]) -> None:
    """Measure, and write after each, so that what is done stays."""
    for name in names or list(MEASURES):
        write_figure(name, MEASURES[name]())
        sys.stdout.write(f"{name} measured\n")


if __name__ == "__main__":
    main(sys.argv[1:])
