"""Skin markers over bones whose pose was measured: how far found bones turn from the true ones."""

from __future__ import annotations

import csv
from collections import abc
from functools import partial
from pathlib import Path

import numpy as np
import yaml

from scaling_service.files.sto import read_sto
from scaling_service.studies.benchmark import parts
from scaling_service.studies.benchmark.tasks._legs import write_subject
from scaling_service.studies.benchmark.tasks.persons import INTERVAL

JOINTS = {"femur": "hip", "tibia": "knee", "humerus": "shoulder"}
"""Bone to the joint above it, as the data's models name its coordinates JOINT_z, JOINT_x, JOINT_y."""

UNSOUND = ("knee_pins", "knee_pins_cutting", "knee_fluoroscopy")
"""Here bone frames or markers are not the same in all recordings; see the data's own notes."""


def make_cases(data: Path, folder: Path, _seed: int) -> abc.Sequence[parts.Case]:
    """Every sound set both ways: its recordings in two groups, of which either is held out.

    Models are given, and need not stay as they are.
    """
    cases = []
    for box in sorted(p.parent for p in (data / "living_bone").glob("*/subject.yaml")):
        if box.name in UNSOUND:
            continue
        subject = yaml.safe_load((box / "subject.yaml").read_text(encoding="utf-8"))
        groups = [subject["trials"][role] for role in ("calibration", "evaluation")]
        for way, (fitted, held) in {"": groups, "_exchanged": groups[::-1]}.items():
            name = f"{box.name}{way}"
            asked = parts.copy_inputs([box / file for file in ("model.osim", *fitted, *held)], folder / name)
            write_subject(asked, {**subject, "trials": {"calibration": fitted, "evaluation": held}})
            trials = [Path(file).stem for file in held]
            cases.append(
                parts.Case(
                    name=name,
                    judge=partial(judge_bones, box, trials),
                    ours=partial(search_by_ours, asked, held),
                    opensim=partial(track_by_opensim, asked, held),
                )
            )
    return cases


def search_by_ours(asked: Path, held: abc.Sequence[str], answer: Path, run: parts.Run) -> None:
    """What the search finds in the recordings to fit, and the motion of the others with its model."""
    found = run(["discover", asked / "subject.yaml", "--start", "none", "--no-report"])
    (found / "model.osim").replace(answer / "model.osim")
    written = run(["ik", found / "model.json", *(asked / file for file in held)])
    for trial in (Path(file).stem for file in held):
        (written / f"{trial}_ik.mot").replace(answer / f"{trial}.mot")
        (written / f"{trial}_ik_sd.mot").replace(answer / f"{trial}_sd.mot")


def track_by_opensim(asked: Path, held: abc.Sequence[str], answer: Path, _run: parts.Run) -> None:
    """Motion by the inverse kinematics tool, all markers alike; no tool of its asks the other recordings."""
    for file in held:
        motion = answer / f"{Path(file).stem}.mot"
        parts.ask_opensim("track", asked / "model.osim", recording=asked / file, output=motion)


def judge_bones(
    box: Path, trials: abc.Sequence[str], answer: Path, _opensim: Path
) -> abc.Mapping[str, float]:
    """Each bone's turn against the bone before it, and whether stated intervals hold the true angles."""
    own = answer / "model.osim"
    angles, held = [], []
    for trial in trials:
        true = read_bones(box / f"{trial}_bones.csv")
        model = own if own.is_file() else box / "model.osim"
        traced = parts.trace_model(model, answer / f"{trial}.mot")
        if len(traced.times) < min(map(len, true.values())):
            raise parts.NoAnswer("the motion has fewer frames than the recording")
        angles.append(measure_angle_error_deg(traced.turns, true))
        deviations = answer / f"{trial}_sd.mot"
        if deviations.is_file():
            held.append(100.0 * measure_coverage(answer / f"{trial}.mot", deviations, true))
    found = {"angle": parts.rms(np.array(angles))}
    return found | ({"held": float(np.mean(held))} if held else {})


def read_bones(file: Path) -> dict[str, parts.Array]:
    """True rotation of every bone in every frame, (n, 3, 3)."""
    with file.open(encoding="utf-8", newline="") as stream:
        head, *rows = csv.reader(stream)
    values = np.array([[float(x or "nan") for x in row] for row in rows])
    bones = [name.removesuffix("_r11") for name in head if name.endswith("_r11")]
    return {b: values[:, head.index(f"{b}_r11") :][:, :9].reshape(-1, 3, 3) for b in bones}


def measure_angle_error_deg(
    found: abc.Mapping[str, parts.Array], true: abc.Mapping[str, parts.Array]
) -> float:
    """RMS angle between found and true turn of every bone against the bone before it."""
    errors = []
    for above, below in zip(true, list(true)[1:], strict=False):
        n = min(len(found[below]), len(true[below]))
        turns = [np.swapaxes(r[above][:n], 1, 2) @ r[below][:n] for r in (found, true)]
        cosine = (np.einsum("nij,nij->n", *turns) - 1.0) / 2.0
        errors.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    return float(np.sqrt(np.nanmean(np.square(errors))))


def measure_coverage(motion: Path, deviations: Path, true: abc.Mapping[str, parts.Array]) -> float:
    """Share of frames and angles in which the 95 % interval holds the true angle; motions in degrees."""
    found, deviation = read_sto(motion), read_sto(deviations)
    hits = []
    for above, below in zip(true, list(true)[1:], strict=False):
        turn = np.swapaxes(true[above], 1, 2) @ true[below]
        wanted = {
            "z": np.arctan2(-turn[:, 0, 1], turn[:, 1, 1]),
            "x": np.arcsin(np.clip(turn[:, 2, 1], -1.0, 1.0)),
            "y": np.arctan2(-turn[:, 2, 0], turn[:, 2, 2]),
        }
        for axis, angle in wanted.items():
            name = f"{JOINTS[below]}_{axis}"
            ours, spread = (np.radians(table.column(name)) for table in (found, deviation))
            n = min(len(ours), len(angle))
            known = np.isfinite(angle[:n])
            hits.append(
                np.mean(np.abs(parts.wrap(ours[:n] - angle[:n]))[known] <= INTERVAL * spread[:n][known])
            )
    return float(np.mean(hits))
