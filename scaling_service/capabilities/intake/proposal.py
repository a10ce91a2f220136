"""A subject document made of what its files seem to be, around what the user wrote already."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from scaling_service.capabilities.intake.document import ProblemEntry, SizesProof
from scaling_service.capabilities.intake.files import InputFile
from scaling_service.capabilities.intake.recordings import RecordingFile
from scaling_service.capabilities.intake.roles import (
    Roles,
    assign_bones,
    assign_forces,
    assign_others,
    assign_recordings,
)
from scaling_service.documents.subject import MODEL_SUFFIXES, SIZE_UNIT, SubjectDocument
from scaling_service.model.trial import MeasuredSizes, merge

_TRIALS = ("static", "calibration", "evaluation")
_LISTS = ("trials.calibration", "trials.evaluation")


def named_in(document: Mapping[str, Any]) -> dict[str, str]:
    """Place to the file that stands there, in a document that need not be whole.

    Examples
    --------
    >>> named_in({"trials": {"static": "a.trc", "calibration": ["b.trc"]}, "forces": {"b.trc": "b.mot"}})
    {'trials.static': 'a.trc', 'trials.calibration.0': 'b.trc', 'forces.b.trc': 'b.mot'}
    """
    return dict(_named(document))


def _named(document: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    model = document.get("model")
    if isinstance(model, str) and model.lower().endswith(MODEL_SUFFIXES):
        yield "model", model
    for place in ("marker_set", "scale_setup", "image_markers"):
        if document.get(place):
            yield place, str(document[place])
    for part in ("trials", "forces", "bones"):
        for key, value in dict(document.get(part) or {}).items():
            if isinstance(value, list):
                yield from ((f"{part}.{key}.{k}", str(name)) for k, name in enumerate(value))
            elif value is not None and (part, key) != ("bones", "units"):
                yield f"{part}.{key}", str(value)


def assign_roles(found: Sequence[InputFile], document: Mapping[str, Any]) -> Roles:
    """Places of files: as the document has them, else as proposed; parts that it has are left as they are."""
    roles: Roles = {}
    for place, file in named_in(document).items():
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
    document: Mapping[str, Any],
    found: Sequence[InputFile],
    roles: Roles,
    model: str,
    markers: Mapping[str, str],
) -> dict[str, Any] | None:
    """The document with what was proposed; None where there is no recording to use.

    ``document``: what the user wrote. ``roles``: file to its place. ``model``: built-in model, where
    neither the document nor a file gives one. ``markers``: model marker to label, what names do not tell.
    """
    content = dict(document)
    usable = {f.name for f in found if f.usable}
    places: dict[str, list[str]] = {}
    for file, (role, _) in roles.items():
        if file in usable or file in named_in(document).values():
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
            content[part] = given | ({"units": _unit(found, given.values())} if part == "bones" else {})
    if markers:
        content["markers"] = dict(markers)
    return content


def ordered(document: Mapping[str, Any]) -> dict[str, Any]:
    """A subject document with its parts in the order in which they are described."""
    return {key: document[key] for key in SubjectDocument.model_fields if key in document}


def _unit(found: Sequence[InputFile], files: Any) -> str:
    units = [str(f.content) for f in found if f.name in set(files)]
    return max(units, key=units.count, default="mm")


_DECIMALS = 3  # of m and kg: files hold them as 32-bit numbers


def sizes_proof(known: Mapping[str, Any], recordings: Sequence[RecordingFile]) -> SizesProof:
    """Sizes as the document states them, else as the recordings do.

    ``known``: the subject's document, which need not be whole.
    """
    person = known.get("subject") or {}
    own = MeasuredSizes(
        person.get("height_m"),
        person.get("mass_kg"),
        {name.removesuffix(SIZE_UNIT): value * 1e-3 for name, value in (known.get("sizes") or {}).items()},
    )
    found = own.or_else(merge(item.trial.sizes for item in recordings))
    stating = [item.file for item in recordings if item.trial.sizes]
    return SizesProof(
        height_m=_rounded(found.height_m),
        mass_kg=_rounded(found.mass_kg),
        sex=person.get("sex"),
        sizes_mm={name: round(1e3 * length, 1) for name, length in found.lengths_m.items()},
        source=[*(["the document"] if own else []), *stating],
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, _DECIMALS)


def with_sizes(proposed: Mapping[str, Any], sizes: SizesProof) -> dict[str, Any]:
    """A subject document with what is known of the person; what it states already stays."""
    stated = {"height_m": sizes.height_m, "mass_kg": sizes.mass_kg}
    person = {key: value for key, value in stated.items() if value is not None}
    by_hand = {f"{name}{SIZE_UNIT}": value for name, value in sizes.sizes_mm.items()}
    whole = {
        **proposed,
        "subject": {
            **dict(proposed["subject"]),
            **{key: value for key, value in person.items() if proposed["subject"].get(key) is None},
        },
    }
    return whole | ({"sizes": by_hand | dict(proposed.get("sizes") or {})} if by_hand else {})


def unknown_person(sizes: SizesProof) -> Iterator[ProblemEntry]:
    """One question for all of height, mass and sex that is not known."""
    values = {"height_m": sizes.height_m, "mass_kg": sizes.mass_kg, "sex": sizes.sex}
    missing = [name for name, value in values.items() if value is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        words = {"height_m": "height", "mass_kg": "mass", "sex": "sex"}
        example = {"height_m": "1.70", "mass_kg": "62.0", "sex": "F or M"}
        given = ", ".join(f"{name}: {example[name]}" for name in missing)
        yield ProblemEntry(
            severity="warning",
            field="subject",
            problem=f"{_listed([words[name] for name in missing])} of the person {are} not known, "
            "which inertia and all that rests on it need",
            remedy=f"Write `subject: {{{given}}}` with the person's own values",
        )


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
