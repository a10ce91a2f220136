"""What uploaded files are for, by names and movement, and the subject document that follows from it."""

from __future__ import annotations

import re
from collections import abc
from itertools import product
from typing import Any

from scaling_service.capabilities.intake import files as intake_files
from scaling_service.capabilities.intake import result as documents
from scaling_service.capabilities.intake import standing, tables
from scaling_service.core.text import list_few
from scaling_service.documents import subject
from scaling_service.model import trial
from scaling_service.model.anatomy.markers import strip_prefix
from scaling_service.model.forces import GroundForces
from scaling_service.recording import orientation

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
    ("talus", re.compile(r"talus|astragalus")),
)
_RIGHT = re.compile(r"(?<![a-z])r(ight)?(?![a-z])|right")
_LEFT = re.compile(r"(?<![a-z])l(eft)?(?![a-z])|left")

_TRIALS = ("static", "calibration", "evaluation")
_LISTS = ("trials.calibration", "trials.evaluation")

_DECIMALS = 3  # of m and kg: files hold them as 32-bit numbers


def choose_static(roles: abc.Mapping[str, tuple[str, str]]) -> str | None:
    """The file of standing."""
    return next((file for file, (role, _) in roles.items() if role == "trials.static"), None)


def assign_recordings(found: abc.Sequence[intake_files.InputFile]) -> Roles:
    """Standing, movements to fit, movements to judge.

    The markers show who stands still. Of the movements, names tell which serve for what. Without a
    movement to fit, all walks but the first serve for that; without one to judge, the first of those whose
    names say nothing does, a walk before others, if another is left to fit.
    """
    recordings = [f.content for f in found if isinstance(f.content, intake_files.RecordingFile)]
    still = standing.rank_standing(recordings)
    roles: Roles = {}
    if still:
        best, *others = still
        alike = [s.file for s in others if s.merit == best.merit]
        worse = [s.file for s in others if s.file not in alike]
        said = [best.why, *([f"better than {list_few(worse)}"] if worse else [])]
        said += [f"{list_few(alike)} would do as well"] if alike else []
        roles[best.file] = ("trials.static", "; ".join(said))
    quiet = {s.file for s in still}
    moves = {item.file: _by_name(item.file) for item in recordings if item.file not in quiet}
    roles |= {file: (f"trials.{role or 'calibration'}", why) for file, (role, why) in moves.items()}
    held_out = [file for file, (role, _) in moves.items() if role == "evaluation"]
    unnamed = [file for file, (role, _) in moves.items() if role is None]
    if held_out and len(held_out) == len(moves):
        for file in held_out[1:] or held_out:
            roles[file] = ("trials.calibration", "there is no other movement to fit")
    elif not held_out and unnamed and len(moves) > 1:
        walks = {
            item.file
            for item in recordings
            if tables.measure_walk(orientation.apply(item.axes, item.trial))[0] >= tables.WALKED_M
        }
        chosen = next((file for file in unnamed if file in walks), unnamed[0])
        roles[chosen] = ("trials.evaluation", "one movement must be left to judge by")
    return roles


def _by_name(name: str) -> tuple[str | None, str]:
    """What a movement's name says that it is for."""
    for role, pattern in (("evaluation", _EVALUATED), ("calibration", _MOVING)):
        for word in standing.split_into_words(name):
            if pattern.match(word):
                return role, f"its name says {word}"
    still = next((word for word in standing.split_into_words(name) if standing.STANDING.match(word)), None)
    return None, f"its name says {still}, but nobody stands still" if still else "a movement of no known name"


def assign_forces(
    found: abc.Sequence[intake_files.InputFile], roles: abc.Mapping[str, tuple[str, str]]
) -> Roles:
    """Files of forces to the movements that they were recorded with.

    A file that covers a recording's time comes before one that does not; then names count by what they have
    in common. Where two fit equally well, nobody is proposed.
    """
    static = choose_static(roles)
    bare = [
        item
        for item in (f.content for f in found if isinstance(f.content, intake_files.RecordingFile))
        if item.forces is None and item.file in roles and item.file != static
    ]
    scores = {}
    for f, item in product(found, bare):
        if isinstance(f.content, GroundForces):
            # Whether forces last as long as the recording, both from about the same time, and the shared
            # parts of their names over all parts
            late, early = f.content.times[0] - item.trial.times[0], item.trial.times[-1] - f.content.times[-1]
            covered = bool(max(late, early) <= TIMES_S and min(late, early) >= -LONGER_S)
            one, other = _split_name(f.name), _split_name(item.file)
            scores[f.name, item.file] = covered, len(one & other) / len(one | other)
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


def _split_name(name: str) -> set[str]:
    return set(re.findall(r"[a-z]+|\d+", name.rpartition(".")[0].lower()))


def assign_bones(found: abc.Sequence[intake_files.InputFile]) -> Roles:
    """Surfaces whose names say which bone they are; a bone that two files claim is left to the user.

    So is a talus without its tibia, beside which alone its trochlea can be told. A segmentation counts where
    it is the only one and no surface is there.
    """
    maps = [f.name for f in found if f.kind == "segmentation" and f.usable]
    if len(maps) == 1 and not any(f.kind == "mesh" and f.usable for f in found):
        return {maps[0]: ("bones.segmentation", "the only one")}
    claims = [
        (f.name, bone) for f in found if f.kind == "mesh" and f.usable and (bone := recognise_bone(f.name))
    ]
    bones = [bone for _, bone in claims]
    return {
        name: (f"bones.{bone}", "its name says so")
        for name, bone in claims
        if bones.count(bone) == 1 and bones.count(bone.replace("talus", "tibia")) == 1
    }


def recognise_bone(name: str) -> str | None:
    """The bone that a file's name tells.

    Examples
    --------
    >>> [recognise_bone(name) for name in ("S01_Femur_right.stl", "pelvis_no_sacrum.stl", "patella_r.stl")]
    ['femur_r', 'pelvis', None]
    """
    stem = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.rpartition(".")[0]).lower().replace("_", " ")
    bone = next((bone for bone, pattern in _BONES if pattern.search(stem)), None)
    if bone in (None, "pelvis"):
        return bone
    right, left = bool(_RIGHT.search(stem)), bool(_LEFT.search(stem))
    return None if right == left else f"{bone}_{'r' if right else 'l'}"


def assign_others(
    found: abc.Sequence[intake_files.InputFile], imaged: bool
) -> abc.Iterator[tuple[str, tuple[str, str]]]:
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
    if not chosen[0].lower().endswith(".osim"):
        return
    sets = [f.name for f in found if f.kind == "setup" and f.content == "marker_set"]
    if len(sets) == 1:
        yield sets[0], ("marker_set", "the only one")
    # The scale set-up; of several the one whose markers the recordings show
    setups = [f for f in found if f.content == "scale_setup"]
    if len(setups) < 2:
        yield from ((f.name, ("scale_setup", "the only one")) for f in setups)
        return
    recorded = [f.content for f in found if isinstance(f.content, intake_files.RecordingFile)]
    shown = {name for r in recorded for label in r.trial.labels for name in (label, strip_prefix(label))}
    lacking = {f.name: sorted(f.asks - shown) for f in setups if f.usable and f.asks}
    fitting = [name for name, lost in lacking.items() if not lost]
    if len(fitting) == 1:
        others = [f"{n} asks for {list_few(lost)}" for n, lost in lacking.items() if lost]
        yield fitting[0], ("scale_setup", f"its markers are in the recordings; {'; '.join(others)}")


def list_named_files(document: abc.Mapping[str, Any]) -> dict[str, str]:
    """Place to the file that stands there, in a document that need not be whole.

    Examples
    --------
    >>> trials = {"static": "a.trc", "calibration": ["b.trc"]}
    >>> list_named_files({"trials": trials, "forces": {"b.trc": "b.mot"}})
    {'trials.static': 'a.trc', 'trials.calibration.0': 'b.trc', 'forces.b.trc': 'b.mot'}
    """
    found: dict[str, str] = {}
    intake_files.map_files(document, lambda place, name: found.setdefault(place, name))
    return found


def assign_roles(found: abc.Sequence[intake_files.InputFile], document: abc.Mapping[str, Any]) -> Roles:
    """Places of files: as the document has them, else as proposed; parts that it has are left as they are."""
    roles: Roles = {}
    for place, file in list_named_files(document).items():
        part = place.rpartition(".")[0] if place.startswith(_LISTS) else place
        roles.setdefault(file, (part, "the document names it"))
    if not document.get("trials"):
        roles = assign_recordings(found) | roles
    if not document.get("forces"):
        roles = assign_forces(found, roles) | roles
    if not document.get("bones"):
        roles = assign_bones(found) | roles
    imaged = any(role.startswith("bones.") for role, _ in roles.values())
    builtin = bool(document.get("model"))
    taken = {role for role, _ in roles.values()}
    for file, (role, why) in assign_others(found, imaged or builtin):
        if role not in taken:
            roles.setdefault(file, (role, why))
    return roles


def propose_subject(
    document: abc.Mapping[str, Any],
    found: abc.Sequence[intake_files.InputFile],
    roles: Roles,
    model: str,
    markers: abc.Mapping[str, str],
) -> dict[str, Any] | None:
    """The document with what was proposed; None where there is no recording to use.

    ``document``: what the user wrote. ``roles``: file to its place. ``model``: built-in model, where
    neither the document nor a file gives one. ``markers``: model marker to label, what names do not tell.
    """
    content = dict(document)
    usable = {f.name for f in found if f.usable}
    places: dict[str, list[str]] = {}
    for file, (role, _) in roles.items():
        if file in usable or file in list_named_files(document).values():
            places.setdefault(role, []).append(file)
    if not content.get("trials"):
        trials = {
            role.rpartition(".")[2]: files for role, files in places.items() if role.startswith("trials.")
        }
        if not trials:
            return None
        content["trials"] = {
            k: trials[k][0] if k == "static" else sorted(trials[k]) for k in _TRIALS if k in trials
        }
    content["model"] = content.get("model") or next(iter(places.get("model", [])), model)
    for place in ("marker_set", "scale_setup", "image_markers"):
        if place in places:
            content.setdefault(place, places[place][0])
    for part in ("forces", "bones"):
        given = {
            role.partition(".")[2]: files[0] for role, files in places.items() if role.startswith(f"{part}.")
        }
        if given and not content.get(part):
            content[part] = given
            if part == "bones":
                units = [str(f.content) for f in found if f.name in given.values() and f.kind == "mesh"]
                content[part] = given | {"units": max(units, key=units.count, default="mm")}
    if markers:
        content["markers"] = dict(markers)
    return content


def check_sizes(
    known: abc.Mapping[str, Any], stated: abc.Mapping[str, trial.MeasuredSizes]
) -> documents.SizesProof:
    """Sizes as the document states them, else as the files do.

    ``known``: the subject's document, which need not be whole. ``stated``: file to the sizes in it.
    """
    person = known.get("subject") or {}
    own = trial.MeasuredSizes(
        person.get("height_m"),
        person.get("mass_kg"),
        {
            name.removesuffix(subject.SIZE_UNIT): value * 1e-3
            for name, value in (known.get("sizes") or {}).items()
        },
    )
    found = own.or_else(trial.merge(stated.values()))
    return documents.SizesProof(
        height_m=_round_size(found.height_m),
        mass_kg=_round_size(found.mass_kg),
        sex=person.get("sex"),
        sizes_mm={name: round(1e3 * length, 1) for name, length in found.lengths_m.items()},
        source=[*(["the document"] if own else []), *(file for file, sizes in stated.items() if sizes)],
    )


def _round_size(value: float | None) -> float | None:
    return None if value is None else round(value, _DECIMALS)


def with_sizes(proposed: abc.Mapping[str, Any], sizes: documents.SizesProof) -> dict[str, Any]:
    """A subject document with what is known of the person; what it states already stays."""
    stated = {"height_m": sizes.height_m, "mass_kg": sizes.mass_kg}
    person = {key: value for key, value in stated.items() if value is not None}
    by_hand = {f"{name}{subject.SIZE_UNIT}": value for name, value in sizes.sizes_mm.items()}
    whole = {
        **proposed,
        "subject": {
            **dict(proposed["subject"]),
            **{key: value for key, value in person.items() if proposed["subject"].get(key) is None},
        },
    }
    return whole | ({"sizes": by_hand | dict(proposed.get("sizes") or {})} if by_hand else {})


def ask_for_person(sizes: documents.SizesProof) -> abc.Iterator[documents.ProblemEntry]:
    """One question for all of height, mass and sex that is not known."""
    values = {"height_m": sizes.height_m, "mass_kg": sizes.mass_kg, "sex": sizes.sex}
    missing = [name for name, value in values.items() if value is None]
    if missing == ["sex"]:
        yield documents.ProblemEntry(
            severity="note",
            field="subject.sex",
            problem="the person's sex is not known: inertia is taken as the mean of women's and men's",
            remedy="Nothing is to be done; `subject: {sex: F or M}` makes it more certain",
        )
    elif missing:
        are = "is" if len(missing) == 1 else "are"
        words = {"height_m": "height", "mass_kg": "mass", "sex": "sex"}
        example = {"height_m": "1.70", "mass_kg": "62.0", "sex": "F or M"}
        given = ", ".join(f"{name}: {example[name]}" for name in missing)
        *others, last = (words[name] for name in missing)
        listed = " and ".join(filter(None, (", ".join(others), last)))
        yield documents.ProblemEntry(
            severity="warning",
            field="subject",
            problem=f"{listed} of the person {are} not known, which inertia and all that rests on it need",
            remedy=f"Write `subject: {{{given}}}` with the person's own values",
        )
