"""What uploaded files are for: places in the subject's document, proposed by names and movement."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from scaling_service.jobs.proof_files import Found
from scaling_service.jobs.proof_recordings import Seen
from scaling_service.models.forces import GroundForces

STILL_M = 0.01
"""Chosen: the middle marker of somebody who stands sways less than this (standard deviation)."""

Roles = dict[str, tuple[str, str]]
"""File to its place in the document, and why."""

_STANDING = re.compile(r"stat|stand|steh|neutral|[ta][ _-]?pose|anatom", re.IGNORECASE)
_MOVING = re.compile(r"hip|knee|ankle|func|squat|circ|flex", re.IGNORECASE)
_EVALUATED = re.compile(r"walk|gait|gang|run|jog|stair|jump|dyn", re.IGNORECASE)

_BONES = (
    ("pelvis", re.compile(r"pelvi|becken")),
    ("femur", re.compile(r"femur")),
    ("tibia", re.compile(r"tibia")),
)
_RIGHT = re.compile(r"(?<![a-z])r(ight)?(?![a-z])|right")
_LEFT = re.compile(r"(?<![a-z])l(eft)?(?![a-z])|left")


def of_recordings(found: Sequence[Found]) -> Roles:
    """Standing, movements to fit, movements to judge.

    Without a movement to fit, all walks but the first serve for that.
    """
    recordings = [(f.name, f.content) for f in found if isinstance(f.content, Seen)]
    roles: Roles = {}
    for name, seen in recordings:
        role, why = _role(name, seen)
        if role == "static" and any(taken == "trials.static" for taken, _ in roles.values()):
            continue  # one is enough; the others wait for the user
        roles[name] = (f"trials.{role}", why)
    held_out = [name for name, (role, _) in roles.items() if role == "trials.evaluation"]
    if held_out and not any(role == "trials.calibration" for role, _ in roles.values()):
        for name in held_out[1:] or held_out:
            roles[name] = ("trials.calibration", "there is no other movement to fit")
    return roles


def _role(name: str, seen: Seen) -> tuple[str, str]:
    stem = name.rpartition(".")[0]
    for role, pattern in (("static", _STANDING), ("evaluation", _EVALUATED), ("calibration", _MOVING)):
        if found := pattern.search(stem):
            return role, f"its name says {found[0]}"
    spread = np.nanstd(seen.trial.markers, axis=0) if seen.trial.n_frames > 1 else np.zeros((1, 3))
    swaying = float(np.nanmedian(np.linalg.norm(spread, axis=-1)))
    if swaying < STILL_M:
        return "static", f"nothing moves by more than {1e3 * swaying:.0f} mm"
    return "calibration", "a movement whose name says nothing"


def of_forces(found: Sequence[Found], roles: Mapping[str, tuple[str, str]]) -> Roles:
    """Files of forces to the recordings whose names have most in common with theirs, where one stands out."""
    bare = [
        f.name for f in found if isinstance(f.content, Seen) and f.content.forces is None and f.name in roles
    ]
    taken: Roles = {}
    for file in (f.name for f in found if isinstance(f.content, GroundForces)):
        scores = sorted(((_alike(file, name), name) for name in bare), reverse=True)
        clear = scores and scores[0][0] > 0.0 and (len(scores) < 2 or scores[0][0] > scores[1][0])
        if clear and f"forces.{scores[0][1]}" not in {role for role, _ in taken.values()}:
            taken[file] = (f"forces.{scores[0][1]}", f"its name is most like {scores[0][1]}")
    return taken


def _alike(one: str, other: str) -> float:
    """Shared parts of two names over all their parts."""
    a, b = _parts(one), _parts(other)
    return len(a & b) / len(a | b)


def _parts(name: str) -> set[str]:
    return set(re.findall(r"[a-z]+|\d+", name.rpartition(".")[0].lower()))


def of_bones(found: Sequence[Found]) -> Roles:
    """Surfaces whose names say which bone they are; a bone that two files claim is left to the user."""
    claims = [(f.name, bone) for f in found if f.kind == "mesh" and f.usable and (bone := bone_of(f.name))]
    bones = [bone for _, bone in claims]
    return {name: (f"bones.{bone}", "its name says so") for name, bone in claims if bones.count(bone) == 1}


def bone_of(name: str) -> str | None:
    """The bone that a file's name tells.

    Examples
    --------
    >>> bone_of("S01_Femur_right.stl"), bone_of("pelvis_no_sacrum.stl"), bone_of("talus_r.stl")
    ('femur_r', 'pelvis', None)
    """
    stem = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.rpartition(".")[0]).lower().replace("_", " ")
    bone = next((bone for bone, pattern in _BONES if pattern.search(stem)), None)
    if bone in (None, "pelvis"):
        return bone
    right, left = bool(_RIGHT.search(stem)), bool(_LEFT.search(stem))
    return None if right == left else f"{bone}_{'r' if right else 'l'}"


def of_others(found: Sequence[Found], imaged: bool) -> Iterator[tuple[str, tuple[str, str]]]:
    """Model, marker set, scale set-up and image markers, each where there is only one to choose.

    Parameters
    ----------
    imaged : bool
        Whether there are bones, which go with built-in models only.
    """
    markers = [f.name for f in found if f.kind == "image_markers" and f.usable]
    if len(markers) == 1:
        yield markers[0], ("image_markers", "the only one")
    usable = [f.name for f in found if f.kind == "model" and f.usable]
    # What this program wrote may lie beside the file that it was made from.
    models = [name for name in usable if name.lower().endswith(".osim")] or usable
    generic = [name for name in models if re.search(r"generic|unscaled", name, re.IGNORECASE)]
    chosen = generic if len(generic) == 1 else models
    if imaged or len(chosen) != 1:
        return
    yield chosen[0], ("model", "the only one" if len(models) == 1 else "its name says that it is not scaled")
    for place in ("marker_set", "scale_setup") if chosen[0].lower().endswith(".osim") else ():
        files = [f.name for f in found if f.kind == "setup" and f.content == place]
        if len(files) == 1:
            yield files[0], (place, "the only one")
