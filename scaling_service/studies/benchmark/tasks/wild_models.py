"""Small models and recordings that show one fault each, with the right answer by construction or by OpenSim.

``wild/models/CASE/case.json``: ``run`` (words of our command line) and ``must``, of which the checks that any
program's model and motion can be held against are taken: ``motion_follows``, ``coordinates_are``,
``motion_is_steady`` and ``distances_are``.
"""

from __future__ import annotations

import json
from collections import abc
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.files.trc import read_trc
from scaling_service.studies.benchmark import parts

TRUTH = "truth.mot"

CHECKS = ("motion_follows", "coordinates_are", "motion_is_steady", "distances_are")


def make_cases(data: Path, folder: Path, _seed: int) -> abc.Sequence[parts.Case]:
    """All that ask for a motion, or for a scaled model."""
    cases = []
    for file in sorted((data / "wild" / "models").glob("*/case.json")):
        document = json.loads(file.read_text(encoding="utf-8"))
        words, checks = document["run"], [c for c in document["must"] if c["check"] in CHECKS]
        if words[0] not in ("ik", "scale") or not checks:
            continue
        box, scales = file.parent, words[0] == "scale"
        asked = [path for path in box.iterdir() if path.name not in (file.name, TRUTH)]
        copied = parts.copy_inputs(asked, folder / box.name)
        tool = None
        if not scales or (box / "setup_scale.xml").is_file():
            tool = partial(answer_by_opensim, copied, scales)
        cases.append(
            parts.Case(
                name=box.name,
                judge=partial(judge_case, box, checks),
                ours=partial(answer_by_ours, copied, words),
                opensim=tool,
            )
        )
    return cases


def answer_by_ours(box: Path, words: abc.Sequence[str], answer: Path, run: parts.Run) -> None:
    """As the case says it is run."""
    written = run([box / word if (box / word).exists() else word for word in words])
    if words[0] == "scale":
        written = next(path for path in written.iterdir() if (path / "model.osim").is_file())
        (written / "model.osim").replace(answer / "model.osim")
    (written / "motion_ik.mot").replace(answer / "motion.mot")


def answer_by_opensim(box: Path, scales: bool, answer: Path, _run: parts.Run) -> None:
    """OpenSim's tools on the same files, all markers alike."""
    model = box / "model.osim"
    if scales:
        setup, model = box / "setup_scale.xml", answer / "model.osim"
        parts.ask_opensim("scale", setup, model=box / "model.osim", static=box / "static.trc", output=model)
    parts.ask_opensim("track", model, recording=box / "motion.trc", output=answer / "motion.mot")


def judge_case(
    box: Path, checks: abc.Sequence[abc.Mapping[str, Any]], answer: Path, _opensim: Path
) -> abc.Mapping[str, float]:
    """Right where every check holds."""
    scaled = (answer / "model.osim").is_file()
    return {"wrong": 0.0 if all(_holds(check, box, answer, scaled) for check in checks) else 100.0}


def _holds(check: abc.Mapping[str, Any], box: Path, answer: Path, scaled: bool) -> bool:
    model = (
        answer / "model.osim" if check.get("model", "").startswith("OUT/") else box / check.get("model", "")
    )
    if check["check"] == "distances_are":
        if not scaled:
            raise parts.NoAnswer("model.osim is absent")
        found = parts.trace_model(model)
        for pair in check["pairs"]:
            apart = np.linalg.norm(found.joint(pair["from"])[0] - found.joint(pair["to"])[0])
            if abs(parts.MM * float(apart) - pair["mm"]) > check["within_mm"]:
                return False
        return True
    found = parts.trace_model(model, answer / "motion.mot")
    if check["check"] == "motion_follows":
        # Whether the motion brings the model's markers to the recorded ones
        recording = box / check["recording"]
        seen = read_trc(recording)
        times = parts.match_times(found.times, seen.times)
        both = [n for n in seen.labels if n in found.markers and n not in check.get("not", ())]
        if not both:
            raise parts.NoAnswer("the model has none of the recording's markers")
        gaps = parts.MM * np.array(
            [
                np.linalg.norm(found.markers[n][times] - seen.markers[:, seen.labels.index(n)], axis=1)
                for n in both
            ]
        )
        return bool(np.nanmean(gaps) <= check["mean_mm"] and np.nanmax(gaps) <= check.get("max_mm", np.inf))
    if check["check"] == "motion_is_steady":
        turns = [v for n, v in found.coordinates.items() if n not in found.slides | set(check.get("not", ()))]
        return bool(np.degrees(max(np.abs(np.diff(v)).max() for v in turns)) <= check["at_most_deg"])
    true = parts.trace_model(box / check["model"], box / check["truth"])
    rows = parts.match_times(found.times, true.times)
    for name in check["names"]:
        off = found.coordinates[name][rows] - true.coordinates[name]
        if name in true.slides:
            if parts.MM * np.abs(off).max() > check.get("within_mm", 1.0):
                return False
        elif (
            np.degrees(np.abs(off if check.get("turns_count") else parts.wrap(off)).max())
            > check["within_deg"]
        ):
            return False
    return True
