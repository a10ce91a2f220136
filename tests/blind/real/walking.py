"""A walking person whose bones were imaged: nothing is hidden, and what is really there is to be told."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import yaml

NAME = "walking_with_bones"
FOLDER = "jia_mri"
PERSON = {"id": "walking", "height_m": 1.62, "mass_kg": 63.0}
"""As the recordings' own notes have it."""

STATIC, CALIBRATION, EVALUATION = "Static.c3d", ["Walking02.c3d"], ["Walking01.c3d", "Walking04.c3d"]
BONES = {"pelvis": "pelvis_no_sacrum", "femur_r": "femur_r", "tibia_r": "tibia_r"}
ON_SEGMENTS = {
    f"{side}{end}": f"{bone}_{side.lower()}"
    for side in "RL"
    for end, bone in (("THI", "femur"), ("TUB", "tibia"), ("SHN", "tibia"))
}
"""Labels that the model does not have, and the segments that they are stuck on."""


def make_walking(data: Path, out: Path) -> str:
    """Write the subject folder and its label; gives the case's name."""
    folder = out / "subjects" / "real_walking"
    (folder / "bones").mkdir(parents=True, exist_ok=True)
    for name in (STATIC, *CALIBRATION, *EVALUATION, "image_markers.csv"):
        shutil.copyfile(data / FOLDER / name, folder / name)
    for mesh in BONES.values():
        shutil.copyfile(data / FOLDER / "bones" / f"{mesh}.stl", folder / "bones" / f"{mesh}.stl")
    document: dict[str, Any] = {
        "subject": PERSON,
        "model": "lower_limb_14dof",
        "extra_markers": ON_SEGMENTS,
        "trials": {"static": STATIC, "calibration": CALIBRATION, "evaluation": EVALUATION},
        "bones": {"units": "mm", **{bone: f"bones/{mesh}.stl" for bone, mesh in BONES.items()}},
        "image_markers": "image_markers.csv",
    }
    (folder / "subject.yaml").write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    truth = {
        "id": folder.name, "group": "real", "kinds": [NAME], "size": "real", "movement": "gait",
        "forces": False, "c3d": True, "real": True, "seed": 0,
        "body_mass_kg": PERSON["mass_kg"], "hidden": [],
        "calibration": [Path(t).stem for t in CALIBRATION],
        "evaluation": [Path(t).stem for t in EVALUATION],
    }  # fmt: skip
    labels = out / "labels"
    labels.mkdir(parents=True, exist_ok=True)
    (labels / f"{folder.name}.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")
    return folder.name
