"""How far others are from OpenSim's own scale and inverse kinematics tools on OpenSim's own examples.

OpenSim is the yardstick here, so its own row is zero: agreement, not truth.
"""

from __future__ import annotations

from collections import abc
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from scaling_service.studies.benchmark import parts
from scaling_service.studies.benchmark.tasks._legs import write_subject

_LEGS = ("hip", "knee", "ankle")


def make_cases(data: Path, folder: Path, _seed: int) -> abc.Sequence[parts.Case]:
    """gait2354 in one step; Rajagopal's model by the first of its two, which sets the sizes."""
    gait, walk = data / "gait2354", data / "rajagopal_walk"
    files = {
        "gait2354": {
            "model": gait / "gait2354_simbody.osim",
            "marker_set": gait / "gait2354_Scale_MarkerSet.xml",
            "scale_setup": gait / "subject01_Setup_Scale.xml",
            "static": gait / "subject01_static.trc",
            "walk": gait / "subject01_walk1.trc",
        },
        "rajagopal": {
            "model": walk / "Rajagopal2016.osim",
            "marker_set": walk / "markerset_walk_preScale.xml",
            "scale_setup": walk / "scale_setup_walk_scaleOnly.xml",
            "static": walk / "static_walk_1.trc",
            "walk": walk / "motion_capture_walk.trc",
        },
    }
    cases = []
    for name, paths in files.items():
        box = parts.copy_inputs(paths.values(), folder / name)
        document = {
            "subject": {"id": name},
            "trials": {
                "static": str(paths["static"].resolve()),
                "evaluation": [str(paths["walk"].resolve())],
            },
            **{key: paths[key].name for key in ("model", "marker_set", "scale_setup")},
        }
        write_subject(box, document)
        cases.append(
            parts.Case(
                name=name,
                judge=judge_agreement,
                ours=partial(answer_by_ours, box, paths["walk"].stem),
                opensim=partial(answer_by_opensim, paths),
            )
        )
    return cases


def answer_by_ours(box: Path, walk: str, answer: Path, run: parts.Run) -> None:
    """The set-up's measurements, then the walk by least squares as OpenSim takes it."""
    words = ["scale", box / "subject.yaml", "--method", "MB", "--smooth-hz", "0"]
    written = run(words) / "MB"
    (written / "model.osim").replace(answer / "model.osim")
    (written / f"{walk}_ik.mot").replace(answer / "walk.mot")


def answer_by_opensim(paths: abc.Mapping[str, Path], answer: Path, _run: parts.Run) -> None:
    """The scale tool, then the inverse kinematics tool with all markers alike."""
    given = {key: paths[key] for key in ("model", "marker_set", "static")}
    parts.ask_opensim("scale", paths["scale_setup"], output=answer / "model.osim", **given)
    parts.ask_opensim("track", answer / "model.osim", recording=paths["walk"], output=answer / "walk.mot")


def judge_agreement(answer: Path, opensim: Path) -> abc.Mapping[str, float]:
    """Distances between joints of the legs at the default pose, and the legs' angles in the walk."""
    ours, theirs = (parts.trace_model(f / "model.osim") for f in (answer, opensim))
    gaps = []
    for side in "rl":
        for above, below in pairwise(_LEGS):
            gaps.append(_measure(ours, above, below, side) - _measure(theirs, above, below, side))
    moved = [parts.trace_model(f / "model.osim", f / "walk.mot") for f in (answer, opensim)]
    rows = parts.match_times(moved[0].times, moved[1].times)
    names = [n for n in moved[1].coordinates if n.startswith(_LEGS) and n not in moved[1].slides]
    if lost := [n for n in names if n not in moved[0].coordinates]:
        raise parts.NoAnswer(f"the model lacks the coordinates {', '.join(lost)}")
    angles = [parts.wrap(moved[0].coordinates[n][rows] - moved[1].coordinates[n]) for n in names]
    places = [
        _find_joint(moved[0], joint, s)[rows] - _find_joint(moved[1], joint, s)
        for joint in _LEGS
        for s in "rl"
    ]
    return {
        "lengths": parts.MM * parts.rms(np.array(gaps)),
        "centres": parts.MM * float(np.mean([np.linalg.norm(p, axis=1).mean() for p in places])),
        "angles": float(np.degrees(parts.rms(np.array(angles)))),
    }


def _find_joint(model: parts.Traced, joint: str, side: str) -> parts.Array:
    """A joint's places by the end of its name: knees are called ``knee_r`` or ``walker_knee_r``."""
    names = [name for name in model.joints if name.endswith(f"{joint}_{side}")]
    return model.joint(names[0] if names else f"{joint}_{side}")


def _measure(model: parts.Traced, above: str, below: str, side: str) -> float:
    """Distance between two joints of a leg at the first pose, m."""
    return float(np.linalg.norm(_find_joint(model, above, side)[0] - _find_joint(model, below, side)[0]))
