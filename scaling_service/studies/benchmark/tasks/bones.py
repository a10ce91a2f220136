"""Bones as they are found: turned, cut, noisy, of the wrong side, or another bone altogether.

An entry's answer for the clean bones says where landmarks should then be; whether they are right to
begin with is asked by the task on CT and MRI.
"""

from __future__ import annotations

import json
from collections import abc
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from scaling_service.studies.benchmark import parts
from scaling_service.studies.benchmark.tasks import images

Bones = dict[str, trimesh.Trimesh]
Place = abc.Callable[[parts.Array], parts.Array]
Change = abc.Callable[[Bones, parts.Array], tuple[Bones, Place]]
"""Bones, and the direction from knee to hip, to changed bones and where their points then are."""

TIGHT_MM, LOOSE_MM = 0.5, 5.0
"""Chosen: a motion changes nothing; holes, noise and cuts move what they touch, within what raters differ by
(Della Croce 2005: 2-6 mm)."""

MUST_REFUSE = "must refuse"


def _turn(bones: Bones, _up: parts.Array) -> tuple[Bones, Place]:
    turn = Rotation.random(random_state=1)
    shift = np.array([300.0, -900.0, 1500.0])
    moved = {
        s: trimesh.Trimesh(turn.apply(m.vertices) + shift, m.faces, process=False) for s, m in bones.items()
    }
    return moved, lambda points: turn.apply(points) + shift


def _stay(points: parts.Array) -> parts.Array:
    return points


def _add_noise(bones: Bones, _up: parts.Array) -> tuple[Bones, Place]:
    rng = np.random.default_rng(1)
    return {
        s: trimesh.Trimesh(m.vertices + rng.normal(0.0, 0.5, m.vertices.shape), m.faces, process=False)
        for s, m in bones.items()
    }, _stay


def _turn_inside_out(bones: Bones, _up: parts.Array) -> tuple[Bones, Place]:
    return {s: trimesh.Trimesh(m.vertices, m.faces[:, ::-1], process=False) for s, m in bones.items()}, _stay


def _cut(bones: Bones, up: parts.Array, share: float, *, top: bool) -> tuple[Bones, Place]:
    """The femur alone, without a share of its length at one end."""
    femur = bones["femur_r"]
    height = femur.vertices @ up
    level = float(np.ptp(height)) * share
    kept = height < height.max() - level if top else height > height.min() + level
    faces = femur.faces[kept[femur.faces].all(axis=1)]
    return {"femur_r": trimesh.Trimesh(femur.vertices, faces, process=True)}, _stay


def _mirror(bones: Bones, _up: parts.Array) -> tuple[Bones, Place]:
    femur = bones["femur_r"]
    flipped = trimesh.Trimesh(femur.vertices * [-1, 1, 1], femur.faces[:, ::-1], process=False)
    return {"femur_r": flipped}, _stay


def _double(bones: Bones, _up: parts.Array) -> tuple[Bones, Place]:
    femur = bones["femur_r"]
    other = femur.copy()
    other.apply_translation([90.0, 0.0, 0.0])
    faces = np.concatenate([femur.faces, other.faces + len(femur.vertices)])
    vertices = np.concatenate([femur.vertices, other.vertices])
    return {"femur_r": trimesh.Trimesh(vertices, faces, process=False)}, _stay


def list_variants() -> abc.Mapping[str, tuple[Change, float | str, tuple[str, ...]]]:
    """What becomes of the bones, how far landmarks may then be off (mm), and what must still be given."""
    return {
        "clean": (lambda bones, _up: (bones, _stay), TIGHT_MM, ("hip_centre", "knee_centre")),
        "turned": (_turn, TIGHT_MM, ("hip_centre", "knee_centre")),
        "inside_out": (_turn_inside_out, TIGHT_MM, ("hip_centre", "knee_centre")),
        "noise": (_add_noise, LOOSE_MM, ("hip_centre", "knee_centre")),
        "no_head": (partial(_cut, share=0.33, top=True), LOOSE_MM, ("knee_centre",)),
        "no_condyles": (partial(_cut, share=0.33, top=False), LOOSE_MM, ("hip_centre",)),
        "other_side": (_mirror, MUST_REFUSE, ()),
        "tibia_for_femur": (lambda bones, _up: ({"femur_r": bones["tibia_r"]}, _stay), MUST_REFUSE, ()),
        "two_femurs": (_double, MUST_REFUSE, ()),
    }


def make_cases(data: Path, folder: Path, _seed: int) -> abc.Sequence[parts.Case]:
    """Every variant of the right femur and tibia of three persons."""
    cases = []
    for person, (where, expert) in images.list_imaged(data).items():
        bones = {}
        for s in ("femur_r", "tibia_r"):
            file = images.find_bone(where, s)
            surface = trimesh.load_mesh(file)
            assert isinstance(surface, trimesh.Trimesh)
            bones[s] = surface
        up = expert["hip_r"][0] - expert["knee_r"][0]
        for variant, (change, within, must) in list_variants().items():
            changed, place = change(bones, up / np.linalg.norm(up))
            box = folder / f"{person}_{variant}"
            box.mkdir(parents=True, exist_ok=True)
            files = {slot: box / f"{slot}.stl" for slot in changed}
            for slot, mesh in changed.items():
                mesh.export(files[slot])
            judge: parts.Judge
            if isinstance(within, str):
                judge = judge_refusal
            else:
                judge = partial(judge_variant, f"{person}_clean", place, within, must)
            cases.append(parts.Case(name=box.name, judge=judge, ours=partial(answer_by_ours, files)))
    return cases


def answer_by_ours(files: abc.Mapping[str, Path], answer: Path, run: parts.Run) -> None:
    """Landmarks, or that the bones were refused."""
    slots = [word for slot, path in files.items() for word in (f"--{slot}", path)]
    try:
        written = run(["landmarks", "--units", "mm", *slots])
    except parts.ProgramFailed as reason:
        (answer / "answer.json").write_text(json.dumps({"refused": str(reason)}), encoding="utf-8")
        return
    (written / "landmarks.json").replace(answer / "landmarks.json")


def judge_refusal(answer: Path, _opensim: Path) -> abc.Mapping[str, float]:
    """Right is a refusal; landmarks of a wrong bone are wrong."""
    if (answer / "landmarks.json").is_file():
        return {"wrong": 100.0}
    if "refused" not in parts.read_answer(answer):
        raise parts.NoAnswer("answer.json does not say `refused`")
    return {"wrong": 0.0}


def judge_variant(
    clean: str, place: Place, within_mm: float, must: tuple[str, ...], answer: Path, _opensim: Path
) -> abc.Mapping[str, float]:
    """Whether what must be given is there, and no point of the femur is off by more than the tolerance.

    Or than three of the deviations that are stated for it.
    """
    if not (answer / "landmarks.json").is_file():
        if "refused" in parts.read_answer(answer):
            return {"wrong": 100.0}
        raise parts.NoAnswer("landmarks.json is absent")
    wanted = parts.read_answer(answer.parent / clean, "landmarks.json").get("femur_r", {})
    found = parts.read_answer(answer, "landmarks.json").get("femur_r", {})
    stated = found.get("deviations_mm", {})
    names = [k.removesuffix("_mm") for k, v in found.items() if k.endswith("_mm") and isinstance(v, list)]
    off = {
        name: float(np.linalg.norm(np.array(found[f"{name}_mm"]) - place(np.array(wanted[f"{name}_mm"]))))
        for name in names
        if f"{name}_mm" in wanted
    }
    right = all(name in off for name in must) and all(
        gap <= max(within_mm, 3.0 * float(stated.get(name, 0.0))) for name, gap in off.items()
    )
    return {"wrong": 0.0 if right else 100.0}
