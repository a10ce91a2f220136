"""What uploaded files are for: places in the subject's document, proposed by names and movement."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from scaling_service.capabilities.intake.files import InputFile
from scaling_service.capabilities.intake.recordings import RecordingFile
from scaling_service.capabilities.intake.standing import STANDING, Standing, rank_standing, words
from scaling_service.capabilities.intake.tables import WALKED_M, walked
from scaling_service.core.text import few
from scaling_service.model.forces import GroundForces

TIMES_S, LONGER_S = 0.1, 1.0
"""Chosen: forces may begin and end this much later and earlier than the markers (other clocks, rounding), and
this much before and after them."""

Roles = dict[str, tuple[str, str]]  # file to its place in the document, and why

_MOVING = re.compile(r"hip|knee|ankle|func|squat|circ|flex|star")
_EVALUATED = re.compile(r"walk|gait|gang|run|jog|stair|jump|hop|dyn")
"""How a word of a movement's name begins."""

_BONES = (
    ("pelvis", re.compile(r"pelvi|becken")),
    ("femur", re.compile(r"femur")),
    ("tibia", re.compile(r"tibia")),
)
_RIGHT = re.compile(r"(?<![a-z])r(ight)?(?![a-z])|right")
_LEFT = re.compile(r"(?<![a-z])l(eft)?(?![a-z])|left")


def static_of(roles: Mapping[str, tuple[str, str]]) -> str | None:
    """The file of standing."""
    return next((file for file, (role, _) in roles.items() if role == "trials.static"), None)


def assign_recordings(found: Sequence[InputFile]) -> Roles:
    """Standing, movements to fit, movements to judge.

    Who stands still is told by the markers. Of the movements, names tell which serve for what. Without a
    movement to fit, all walks but the first serve for that; without one to judge, the first of those whose
    names say nothing does, a walk before others, if another is left to fit.
    """
    recordings = [f.content for f in found if isinstance(f.content, RecordingFile)]
    still = rank_standing(recordings)
    roles: Roles = {s.file: ("trials.static", _best_of(still)) for s in still[:1]}
    quiet = {s.file for s in still}
    moves = {item.file: _by_name(item.file) for item in recordings if item.file not in quiet}
    roles |= {file: (f"trials.{role or 'calibration'}", why) for file, (role, why) in moves.items()}
    held_out = [file for file, (role, _) in moves.items() if role == "evaluation"]
    unnamed = [file for file, (role, _) in moves.items() if role is None]
    if held_out and len(held_out) == len(moves):
        for file in held_out[1:] or held_out:
            roles[file] = ("trials.calibration", "there is no other movement to fit")
    elif not held_out and unnamed and len(moves) > 1:
        walks = {item.file for item in recordings if walked(item.trial, item.axes) >= WALKED_M}
        chosen = next((file for file in unnamed if file in walks), unnamed[0])
        roles[chosen] = ("trials.evaluation", "one movement must be left to judge by")
    return roles


def _best_of(still: Sequence[Standing]) -> str:
    """Why the first of those that stand still was taken."""
    best, *others = still
    alike = [s.file for s in others if s.merit == best.merit]
    worse = [s.file for s in others if s.file not in alike]
    parts = [best.why, *([f"better than {few(worse)}"] if worse else [])]
    return "; ".join([*parts, *([f"{few(alike)} would do as well"] if alike else [])])


def _by_name(name: str) -> tuple[str | None, str]:
    """What a movement's name says that it is for."""
    for role, pattern in (("evaluation", _EVALUATED), ("calibration", _MOVING)):
        for word in words(name):
            if pattern.match(word):
                return role, f"its name says {word}"
    still = next((word for word in words(name) if STANDING.match(word)), None)
    return None, f"its name says {still}, but nobody stands still" if still else "a movement of no known name"


def assign_forces(found: Sequence[InputFile], roles: Mapping[str, tuple[str, str]]) -> Roles:
    """Files of forces to the movements that they were recorded with.

    A file that covers a recording's time comes before one that does not; then names count by what they have
    in common. Where two fit equally well, nobody is proposed.
    """
    static = static_of(roles)
    bare = [
        item
        for item in (f.content for f in found if isinstance(f.content, RecordingFile))
        if item.forces is None and item.file in roles and item.file != static
    ]
    scores = {
        (f.name, item.file): (_covers(f.content, item), _alike(f.name, item.file))
        for f in found
        if isinstance(f.content, GroundForces)
        for item in bare
    }
    taken: Roles = {}
    given: set[str] = set()
    for (file, recording), score in sorted(scores.items(), key=lambda s: s[1], reverse=True):
        rivals = [
            pair
            for pair, other in scores.items()
            if other == score and (pair[0] == file) != (pair[1] == recording)
            if pair[0] not in taken and pair[1] not in given
        ]
        if file in taken or recording in given or score == (False, 0.0) or rivals:
            continue
        covers, alike = score
        why = [f"its name is most like {recording}"] if alike else []
        why += ["it covers the recording's time"] if covers else ["though their times differ"]
        taken[file] = (f"forces.{recording}", ", ".join(why))
        given.add(recording)
    return taken


def _covers(forces: GroundForces, item: RecordingFile) -> bool:
    """Whether forces last as long as a recording, both from about the same time."""
    times = item.trial.times
    late = forces.times[0] - times[0]
    early = times[-1] - forces.times[-1]
    return bool(max(late, early) <= TIMES_S and min(late, early) >= -LONGER_S)


def _alike(one: str, other: str) -> float:
    """Shared parts of two names over all their parts."""
    a, b = _parts(one), _parts(other)
    return len(a & b) / len(a | b)


def _parts(name: str) -> set[str]:
    return set(re.findall(r"[a-z]+|\d+", name.rpartition(".")[0].lower()))


def assign_bones(found: Sequence[InputFile]) -> Roles:
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


def assign_others(found: Sequence[InputFile], imaged: bool) -> Iterator[tuple[str, tuple[str, str]]]:
    """Model, marker set, scale set-up and image markers, each where there is only one to choose.

    ``imaged``: whether there are bones, which go with built-in models only.
    """
    markers = [f.name for f in found if f.kind == "image_markers" and f.usable]
    if imaged and len(markers) == 1:
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
