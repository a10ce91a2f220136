"""Joint centres where an expert saw them in CT and MRI: from markers alone, and from the bones."""

from __future__ import annotations

import csv
import json
from collections import abc
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scaling_service.files.osim.setups import parse_xml
from scaling_service.files.recording import read_recording
from scaling_service.model.trial import Trial
from scaling_service.studies.benchmark import parts
from scaling_service.studies.benchmark.tasks import _legs

IMAGED = {"jia_mri": "jia_mri/bones", "LHDL_CT": "bones/LHDL_CT", "TLEM2_CT": "bones/TLEM2_CT"}
"""Person to the folder of the bones; those that are absent are left out."""

ANKLE = "bones/ankle_wbct"
SURFACES = (".stl", ".obj", ".ply", ".vtp")

CLUSTERS = {
    s + n: f"{b}_{s.lower()}" for s in "RL" for n, b in (("THI", "femur"), ("TUB", "tibia"), ("SHN", "tibia"))
}
"""Further markers of jia_mri, and their segments."""

_SUFFIXES = {"ASI": "ASIS", "PSI": "PSIS", "KNE": "LFE", "MFC": "MFE", "HFB": "FH", "ANK": "LM", "MMA": "MM"}
MARKERS = {side + label: side + marker for side in "RL" for label, marker in _SUFFIXES.items()}
"""Label in the recordings of jia_mri to marker of the generic model."""


def take_markers(file: Path) -> Trial:
    """A recording of jia_mri with the generic model's markers under its names, and the clusters."""
    found = read_recording(file)
    names = {label: MARKERS.get(label, label) for label in found.labels if label in {*MARKERS, *CLUSTERS}}
    return Trial(
        name=file.stem.lower(),
        times=found.times.copy(),
        labels=tuple(names.values()),
        markers=found.markers[:, [found.labels.index(label) for label in names]],
        rate_hz=found.rate_hz,
    )


def write_jia(data: Path, box: Path) -> None:
    """Standing and one walk of jia_mri for any program."""
    folder = data / "jia_mri"
    _legs.write_legs(
        box, [take_markers(folder / f"{name}.c3d") for name in ("Static", "Walking02")], CLUSTERS
    )


def describe_jia(static: str = "static.trc", walk: str = "walking02.trc") -> dict[str, Any]:
    """The subject file that goes with them."""
    return {
        "subject": {"id": "jia", "height_m": 1.62, "mass_kg": 63.0},
        "model": _legs.GENERIC,
        "extra_markers": CLUSTERS,
        "trials": {"static": static, "calibration": [walk]},
    }


def make_marker_cases(data: Path, folder: Path, _seed: int) -> abc.Sequence[parts.Case]:
    """The one person with markers and images."""
    box = folder / "jia_mri"
    write_jia(data, box)
    _legs.write_subject(box, describe_jia())
    judge = partial(judge_markers, read_expert(data / "jia_mri"), data / "jia_mri" / "image_markers.csv")
    ours, theirs = (
        partial(scale, box, "walking02")
        for scale in (partial(_legs.scale_by_ours, "MAP"), _legs.scale_by_opensim)
    )
    return [parts.Case(name=box.name, judge=judge, ours=ours, opensim=theirs)]


def judge_markers(
    expert: abc.Mapping[str, tuple[parts.Array, parts.Array]], seen: Path, answer: Path, _opensim: Path
) -> abc.Mapping[str, float]:
    """The hip against the pelvis's skin markers, as the image shows both, and the femur's length."""
    traced = parts.trace_model(answer / "model.osim")
    with seen.open(encoding="utf-8", newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if row["segment"] == "pelvis"]
    image = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
    own = [MARKERS[row["marker"]] for row in rows]
    if lost := [name for name in own if name not in traced.markers]:
        raise parts.NoAnswer(f"the model lacks the markers {', '.join(lost)}")
    model = parts.MM * np.array([traced.markers[name][0] for name in own])
    turn, _ = Rotation.align_vectors(image - image.mean(axis=0), model - model.mean(axis=0))
    hip, knee = (parts.MM * traced.joint(name)[0] for name in ("hip_r", "knee_r"))
    true = {name: expert[name][0] for name in ("hip_r", "knee_r")}
    found = turn.apply(hip - model.mean(axis=0)) + image.mean(axis=0)
    length = float(np.linalg.norm(true["hip_r"] - true["knee_r"]))
    return {
        "hip": float(np.linalg.norm(found - true["hip_r"])),
        "femur": abs(float(np.linalg.norm(hip - knee)) - length),
    }


def make_bone_cases(data: Path, folder: Path, _seed: int) -> abc.Sequence[parts.Case]:
    """Femur, tibia and talus of three persons, and an ankle in pieces."""
    cases = []
    for name, (where, expert) in list_imaged(data).items():
        bones = _copy_bones(where, ("femur_r", "tibia_r", "talus_r"), folder / name)
        cases.append(
            parts.Case(name=name, judge=partial(judge_bones, expert), ours=partial(find_landmarks, bones))
        )
    pieces = data / ANKLE
    if pieces.is_dir():
        cylinder = json.loads((pieces / "truth.json").read_text(encoding="utf-8"))["talocrural"]
        bones = _copy_bones(pieces, ("tibia_r", "talus_r"), folder / pieces.name)
        judge = partial(judge_ankle, np.array(cylinder["centre_mm"]))
        cases.append(parts.Case(name=pieces.name, judge=judge, ours=partial(find_landmarks, bones)))
    return cases


def _copy_bones(source: Path, slots: abc.Sequence[str], box: Path) -> dict[str, Path]:
    files = {slot: find_bone(source, slot) for slot in slots}
    parts.copy_inputs(files.values(), box)
    return {slot: box / file.name for slot, file in files.items()}


def find_landmarks(bones: abc.Mapping[str, Path], answer: Path, run: parts.Run) -> None:
    """Ours, from surfaces in mm."""
    slots = [word for slot, path in bones.items() for word in (f"--{slot}", path)]
    written = run(["landmarks", "--units", "mm", *slots])
    (written / "landmarks.json").replace(answer / "landmarks.json")


def judge_bones(
    expert: abc.Mapping[str, tuple[parts.Array, parts.Array]], answer: Path, _opensim: Path
) -> abc.Mapping[str, float]:
    """Hip, knee and ankle against the expert's, and the knee's axis (the cylinder, where there is one)."""
    document = parts.read_answer(answer, "landmarks.json")
    femur, tibia = document.get("femur_r", {}), document.get("tibia_r", {})
    off = {
        "hip": _measure_gap(femur, "hip_centre_mm", expert["hip_r"][0]),
        "knee": _measure_gap(femur, "knee_centre_mm", expert["knee_r"][0]),
        "ankle": _measure_gap(tibia, "ankle_centre_mm", expert["ankle_r"][0]),
    }
    axis = np.array(femur.get("knee_axis_cylinder") or femur.get("knee_axis"), dtype=float)
    true = expert["knee_r"][1]
    cosine = abs(axis @ true) / np.linalg.norm(axis) / np.linalg.norm(true)
    return {
        "centres": float(np.mean(list(off.values()))),
        **off,
        "axis": float(np.degrees(np.arccos(min(cosine, 1.0)))),
    }


def judge_ankle(centre: parts.Array, answer: Path, _opensim: Path) -> abc.Mapping[str, float]:
    """The ankle of a distal shank and a talus, against the trochlea's cylinder."""
    tibia = parts.read_answer(answer, "landmarks.json").get("tibia_r", {})
    off = _measure_gap(tibia, "ankle_centre_mm", centre)
    return {"centres": off, "ankle": off}


def _measure_gap(bone: abc.Mapping[str, Any], key: str, true: parts.Array) -> float:
    if not isinstance(bone.get(key), list):
        raise parts.NoAnswer(f"landmarks.json has no {key}")
    found: parts.Array = np.array(bone[key], dtype=float)
    return float(np.linalg.norm(found - true))


def read_expert(folder: Path) -> abc.Mapping[str, tuple[parts.Array, parts.Array]]:
    """Joint to its centre (3,), mm, and its z axis (3,) in the image, as the expert has them.

    From ``reference_joints.json``, or else from ``manual_model.osim``, whose bodies have the image's axes.
    """
    listed = folder / "reference_joints.json"
    if listed.is_file():
        joints = json.loads(listed.read_text(encoding="utf-8"))["manual"]
        return {
            name: (np.array(joint["centre_mm"]), np.array(joint["axes_in_image_frame"]["Z"]))
            for name, joint in joints.items()
        }
    found = {}
    for joint in parse_xml(folder / "manual_model.osim").iter("CustomJoint"):
        frame = joint.findall(".//PhysicalOffsetFrame")[-1]
        place, angles = (
            np.array((frame.findtext(tag) or "").split(), dtype=float)
            for tag in ("translation", "orientation")
        )
        turn = Rotation.from_euler("XYZ", angles)
        found[str(joint.get("name"))] = parts.MM * place, turn.apply([0.0, 0.0, 1.0])
    return found


def list_imaged(data: Path) -> dict[str, tuple[Path, abc.Mapping[str, tuple[parts.Array, parts.Array]]]]:
    """Persons whose bones are there: the folder of the bones, and the expert's joints."""
    return {
        name: (data / where, read_expert(data / ("jia_mri" if name == "jia_mri" else where)))
        for name, where in IMAGED.items()
        if (data / where).is_dir()
    }


def find_bone(folder: Path, slot: str) -> Path:
    """A bone's surface, whatever its format."""
    return next(path for path in sorted(folder.glob(f"{slot}.*")) if path.suffix in SURFACES)
