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

from scaling_service.core.names import spell_name
from scaling_service.guide.pages import FIGURES
from scaling_service.report.tables import Table, to_cell
from scaling_service.studies.benchmark.parts import OURS
from scaling_service.studies.benchmark.result import DOCUMENT, BenchmarkDocument, make_tables, read_document
from tests.living_bone.errors import Way, judge_sets
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

MOVED = {
    "cadaver_hip": "cadaver, hip circles; pins",
    "knee_fluoroscopy_step": "step down; fluoroscopy",
    "knee_implant_sit": "sitting down, knee implant; fluoroscopy",
    "knee_implant_steps": "step up and knee extension, knee implant; fluoroscopy",
    "knee_pins_hop": "hopping; pins",
    "shoulder_pins": "arm raised, eating; pins",
    "shoulder_pins_reach": "hand behind the back; pins",
}
"""Recordings over bones of known pose."""


def measure_pins() -> dict[str, Any]:
    """Bones' errors before and after what ``discover`` knows of bones, both ways, and coverage."""
    root = _data("living_bone")
    given, left_out = (list(judge_sets(root, leave_out=out)) for out in (False, True))
    rows = [
        [
            MOVED[one.measured.name] + (", exchanged" if one.exchanged else ""),
            f"{one.before:.1f}",
            f"{one.after:.1f}",
            f"{one.ratio:.2f}",
            f"{other.ratio:.2f}",
            f"{one.covered:.0%}",
            f"{one.covered_after:.0%}",
        ]
        for one, other in zip(given, left_out, strict=True)
    ]
    columns = [
        "held-out recording",
        "error before, deg",
        "after, deg",
        "after / before",
        "its laboratory left out",
        "95 % intervals before hold",
        "after",
    ]
    return {
        "ratio": _average_ratio(given),
        "worst": max(one.ratio for one in given),
        "left_out_ratio": _average_ratio(left_out),
        "left_out_worst": max(one.ratio for one in left_out),
        "covered": float(np.mean([one.covered for one in given])),
        "least_covered": min(one.covered for one in given),
        "most_covered": max(one.covered for one in given),
        "table": {"columns": columns, "rows": rows},
    }


def _average_ratio(ways: Sequence[Way]) -> float:
    return float(np.exp(np.mean(np.log([one.ratio for one in ways]))))


def measure_persons() -> dict[str, Any]:
    """Errors and intervals of each method on virtual persons drawn by the tests' own code."""
    found = measure(range(300, 300 + PERSONS), ["MB", "MB_lam", "MB_am", "MAP"])
    rows = [
        [
            method if k == 0 else "",
            spell_name(name),
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
    columns = [
        "method",
        "held-out error, mm",
        "distance between the hips, mm",
        "femur, right, mm",
        "shank, right, mm",
    ]
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
