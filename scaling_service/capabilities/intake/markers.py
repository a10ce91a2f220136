"""Which label is which marker, where further labels sit, and what the marker set means for each method."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scaling_service.capabilities.intake.document import (
    Candidate,
    ExtraMarker,
    MarkerProof,
    MarkerSetProof,
    SizesProof,
)
from scaling_service.capabilities.motion.ranges import list_hidden_segments
from scaling_service.model.anatomy.marker_sets import assign_tracking_segments, find_plane_marker, recognise
from scaling_service.model.anatomy.markers import (
    describe_likeness,
    find_canonical,
    is_computed,
    look_up_meaning,
    strip_prefix,
)
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.poses import pose_neutral_markers
from scaling_service.model.trial import Array, Trial, is_unlabelled
from scaling_service.numerics.multibody.rigid import fit_rigid

CONFIDENCE: Mapping[str, float] = {
    "": 1.0,
    "prefix left out": 0.99,
    "capitals ignored": 0.95,
    "known alias": 0.9,
}
"""By what is left out of account in comparing names. Chosen: an order, not probabilities."""

AMBIGUOUS = 0.4  # chosen: of a marker that two labels fit equally well

NEAR_M, MOST_BY_PLACE = 0.12, 0.6
"""Chosen: a label farther than this from where the model expects a marker is not proposed for it, and one
right there is less sure than any name."""

FEWEST_KNOWN = 4  # markers that tell where the model stands (three, and one to spare)

_MOST_OTHERS = 3


@dataclass(frozen=True, slots=True)
class _Choice:
    label: str
    confidence: float
    why: str
    source: str


def propose_markers(
    model: BodyModel,
    trials: Mapping[str, Trial],
    standing: Trial | None,
    document: Mapping[str, str],
    laboratory: Mapping[str, str],
) -> tuple[list[MarkerProof], list[str]]:
    """A label for every marker of a model.

    ``trials``: name to recording, in one set of axes, m. ``standing``: the one in which places are
    compared. ``document``: model marker to label, as the subject's document says. ``laboratory``: label to
    model marker, as the laboratory has them. Returns ``unused``: labels that no marker took.
    """
    labels = list(dict.fromkeys(label for trial in trials.values() for label in trial.labels))
    wanted = [m.name for m in model.markers if m.weight > 0.0]
    offers = {marker: list(_by_name(marker, labels, document, laboratory)) for marker in wanted}
    taken = _assign(offers)
    if standing is not None:
        for marker, choice in _by_place(
            model, standing, taken, [m for m in wanted if m not in taken]
        ).items():
            taken[marker] = choice
    used = {choice.label for choice in taken.values()}
    unused = [label for label in labels if label not in used]
    entries = [_make_entry(model, marker, taken.get(marker), offers[marker], trials) for marker in wanted]
    return entries, unused


def _by_name(
    marker: str, labels: Sequence[str], document: Mapping[str, str], laboratory: Mapping[str, str]
) -> Iterator[_Choice]:
    for label in labels:
        plain = strip_prefix(label)
        if document.get(marker) in (label, plain):
            yield _Choice(label, 1.0, "as the subject's document says", "document")
        elif laboratory.get(label, laboratory.get(plain)) == marker:
            yield _Choice(label, 0.99, "as the laboratory's map says", "laboratory")
        elif (reason := describe_likeness(label, marker)) is not None:
            yield _Choice(label, CONFIDENCE[reason], reason or "the same name", "name")


def _assign(offers: Mapping[str, list[_Choice]]) -> dict[str, _Choice]:
    """The surest offers first; no label is used twice. Of two equally sure ones, the first, less sure."""
    taken: dict[str, _Choice] = {}
    used: set[str] = set()
    order = sorted(offers, key=lambda m: -max((c.confidence for c in offers[m]), default=0.0))
    for marker in order:
        free = sorted((c for c in offers[marker] if c.label not in used), key=lambda c: -c.confidence)
        if not free:
            continue
        best = free[0]
        rivals = [c.label for c in free[1:] if c.confidence == best.confidence]
        if rivals:
            why = f"{best.why}, but {' and '.join(rivals)} would fit as well"
            best = _Choice(best.label, AMBIGUOUS, why, best.source)
        taken[marker] = best
        used.add(best.label)
    return taken


def _by_place(
    model: BodyModel, standing: Trial, taken: Mapping[str, _Choice], missing: Sequence[str]
) -> dict[str, _Choice]:
    """Labels that lie where the model, standing as the person does, expects a marker.

    A label that a marker set knows stands for what it says, however near to another marker it lies.
    """
    used = {choice.label for choice in taken.values()}
    seen = {
        label: _find_middle(standing, label)
        for label in standing.labels
        if label in used or (look_up_meaning(label) is None and not is_computed(label))
    }
    seen = {label: at for label, at in seen.items() if np.isfinite(at).all()}
    model_at = pose_neutral_markers(model)
    known = [m for m, choice in taken.items() if choice.label in seen]
    if len(known) < FEWEST_KNOWN:
        return {}
    expected = _place_like(
        model_at, [*known, *missing], known, np.stack([seen[taken[m].label] for m in known])
    )
    pairs = sorted(
        (float(np.linalg.norm(seen[label] - expected[marker])), marker, label)
        for marker in missing
        for label in seen
        if label not in used
    )
    found: dict[str, _Choice] = {}
    for distance, marker, label in pairs:
        if distance < NEAR_M and marker not in found and label not in {c.label for c in found.values()}:
            why = f"{1e3 * distance:.0f} mm from where the model expects it: check it"
            found[marker] = _Choice(label, MOST_BY_PLACE * (1.0 - distance / NEAR_M), why, "place")
    return found


def _find_middle(trial: Trial, label: str) -> Array:
    trajectory = trial.position(label)
    known = trajectory[np.isfinite(trajectory).all(axis=1)]
    return np.asarray(np.median(known, axis=0)) if len(known) else np.full(3, np.nan)


def _place_like(
    model_at: Mapping[str, Array], names: Sequence[str], known: Sequence[str], measured: Array
) -> dict[str, Array]:
    """Markers of the standing model, sized and placed so that the known ones lie as measured."""
    local = np.stack([model_at[name] for name in known])
    size = _measure_extent(measured) / _measure_extent(local)
    R, t = fit_rigid(size * local, measured)
    return {name: R @ (size * model_at[name]) + t for name in names}


def _measure_extent(points: Array) -> float:
    return float(np.linalg.norm(points - points.mean(axis=0)))


def _make_entry(
    model: BodyModel,
    name: str,
    choice: _Choice | None,
    offers: Sequence[_Choice],
    trials: Mapping[str, Trial],
) -> MarkerProof:
    marker = model.marker(name)
    others = [o for o in offers if choice is None or o.label != choice.label]
    return MarkerProof.model_validate(
        {
            "marker": name,
            "segment": marker.segment,
            "anatomical": marker.anatomical,
            "label": None if choice is None else choice.label,
            "confidence": 0.0 if choice is None else round(choice.confidence, 3),
            "why": "no label has this name or lies there" if choice is None else choice.why,
            "source": None if choice is None else choice.source,
            "recordings": [n for n, t in trials.items() if choice is not None and choice.label in t.labels],
            "others": [
                Candidate(label=o.label, confidence=o.confidence, why=o.why) for o in others[:_MOST_OTHERS]
            ],
        }
    )


RIGID_MM, STANDS_OUT = 5.0, 0.6
"""Chosen: distances between markers of one thigh change by less, and by less than this share of what they
change to the next segment's markers; else nothing is said."""

FEWEST = 3  # markers that a segment must have: a shank's marker keeps its distance from both epicondyles, too

_SAID = (("femur", re.compile(r"THI")), ("tibia", re.compile(r"TIB|SHK|SHANK|LEG")))
"""Words in labels of tracking markers that no marker set knows, and where those sit."""


def assign_extra_markers(
    markers: Sequence[MarkerProof], unused: Sequence[str], trials: Mapping[str, Trial], model: BodyModel
) -> list[ExtraMarker]:
    """The segment of each further label: as its set or name says, else the one it keeps its distances to.

    ``markers``: with the labels that were proposed. ``unused``: labels that no marker took; points that
    software computed are left out. ``trials``: name to recording, m.
    """
    known = assign_tracking_segments(unused, model)
    carried: dict[str, list[str]] = {}
    for entry in markers:
        if entry.label is not None:
            carried.setdefault(entry.segment, []).append(entry.label)
    return [
        _make_extra_entry(label, known.get(label), carried, trials)
        for label in unused
        if not is_computed(label) and not is_unlabelled(label)
    ]


def with_extra_markers(
    proposed: Mapping[str, Any], model: BodyModel, unused: Sequence[str], trials: Mapping[str, Trial]
) -> dict[str, Any]:
    """A subject document with the tracking markers that its marker set knows, where it names none itself.

    Only labels that are seen while standing, which places them, and in a movement, which they then follow.

    ``unused``: labels that no marker of the model took. ``trials``: file to recording.
    """
    static = trials.get(str(proposed["trials"].get("static")))
    if proposed.get("extra_markers") or static is None:
        return dict(proposed)
    standing = set(static.shown_labels)
    others = [t for file, t in trials.items() if t is not static and _is_named(file, proposed)]
    moving = {label for trial in others for label in trial.shown_labels}
    known = assign_tracking_segments([label for label in unused if label in standing & moving], model)
    found = {strip_prefix(label): segment for label, segment in known.items()}
    return {**proposed, **({"extra_markers": found} if found else {})}


def _is_named(file: str, proposed: Mapping[str, Any]) -> bool:
    return any(file in proposed["trials"].get(role, ()) for role in ("calibration", "evaluation"))


def _make_extra_entry(
    label: str, known: str | None, carried: Mapping[str, Sequence[str]], trials: Mapping[str, Trial]
) -> ExtraMarker:
    spreads = {name: _spread_mm(label, others, trials) for name, others in carried.items()}
    segment = known or guess_segment(label)
    if segment not in spreads and known is None:
        segment = _clear({name: s for name, s in spreads.items() if len(carried[name]) >= FEWEST})
    spread = float("inf") if segment is None else spreads.get(segment, float("inf"))
    return ExtraMarker(
        label=label, segment=segment, spread_mm=round(spread, 1) if np.isfinite(spread) else None
    )


def guess_segment(label: str) -> str | None:
    """The segment that a label's words tell.

    Examples
    --------
    >>> guess_segment("RTHI"), guess_segment("S01:L_tib2"), guess_segment("C7")
    ('femur_r', 'tibia_l', None)
    """
    plain = strip_prefix(label).upper()
    segment = next((name for name, pattern in _SAID if pattern.search(plain)), None)
    return f"{segment}_{plain[0].lower()}" if segment is not None and plain[0] in "RL" else None


def _clear(spreads: Mapping[str, float]) -> str | None:
    """The segment that stands out by how little distances to it change."""
    order = sorted(spreads, key=lambda name: spreads[name])
    if not order or spreads[order[0]] >= RIGID_MM:
        return None
    stands_out = len(order) < 2 or spreads[order[0]] < STANDS_OUT * spreads[order[1]]
    return order[0] if stands_out else None


def _spread_mm(label: str, others: Sequence[str], trials: Mapping[str, Trial]) -> float:
    """Largest standard deviation of a label's distance to others over all recordings; infinite if unknown."""
    found = [0.0]
    seen = False
    for trial in (t for t in trials.values() if label in t.labels):
        for other in (o for o in others if o in trial.labels):
            distance = np.linalg.norm(trial.position(label) - trial.position(other), axis=1)
            known = distance[np.isfinite(distance)]
            if len(known) > 1:
                found.append(1e3 * float(known.std()))
                seen = True
    return max(found) if seen else float("inf")


_JOINTS = (("knee", "LFE", "MFE", "knee_width", "thigh"), ("ankle", "LM", "MM", "ankle_width", "shank"))
"""Joint, its outer and inner landmark, the width between them, and what carries the marker of its plane."""


def check_marker_set(labels: Sequence[str]) -> MarkerSetProof | None:
    """The set that all labels together are closest to."""
    found = recognise(labels)
    if found is None:
        return None
    return MarkerSetProof(
        name=found.name,
        title=found.title,
        share=round(found.share, 3),
        lacks=list(found.lacks),
        additions=list(found.additions),
    )


def describe_consequences(labels: Sequence[str], sizes: SizesProof) -> Iterator[str]:
    """What landmarks that are missing mean for scaling.

    ``labels``: of all recordings.
    """
    there = {find_canonical(label) for label in labels}
    if "SACR" in there and not {"RPSIS", "LPSIS"} <= there:
        yield (
            "SACR instead of two PSIS markers: it stands for the point half-way between them; "
            "the pelvis' depth and the hip centres rest on it"
        )
    unsure = []
    for joint, outer, inner, width, segment in _JOINTS:
        sides = [s for s in "RL" if f"{s}{outer}" in there and f"{s}{inner}" not in there]
        if not sides:
            continue
        unsure += [joint] if joint == "knee" else []
        yield _of_one_side(joint, width, segment, sides, labels, sizes)
    if unsure:
        yield (
            "MB_lam and MB_am: without an inner knee marker hip rotation and the knee's axis are hardly "
            "determined; a movement that bends the knees, or a static trial with inner markers, tells more"
        )
        yield "EB and EB_am take the knee's centre and axis from the bones, where there are any"


def _of_one_side(
    joint: str, width: str, segment: str, sides: Sequence[str], labels: Sequence[str], sizes: SizesProof
) -> str:
    known = [f"{width}_{side.lower()}" for side in sides]
    measured = [f"{sizes.sizes_mm[name]:g}" for name in known if name in sizes.sizes_mm]
    planes = [
        find_plane_marker(labels, "knee" if joint == "knee" else "ankle", "r" if s == "R" else "l")
        for s in sides
    ]
    text = f"no inner {joint} marker: MB takes the joint's centre from the outer one and half its width"
    text += f" ({' and '.join(measured)} mm)" if len(measured) == len(known) else ""
    if all(planes):
        text += f", in the plane of the {segment}'s marker ({', '.join(p for p in planes if p)})"
    if len(measured) < len(known):
        missing = ", ".join(f"{name}_mm: …" for name in known if name not in sizes.sizes_mm)
        text += f"; the width is not known: measure it and give `sizes: {{{missing}}}`"
    return text


LEGS, FEET, WHOLE = "lower_limb_14dof", "lower_limb_feet_18dof", "full_body_35dof"

LARGELY = 0.9
"""Chosen: share of the whole body's markers that must be there; arms and trunk with fewer cost more than they
tell, and the legs are the safe choice."""

_FOREFOOT = ("TOE", "MT1", "MT5")


def choose_model(movements: Sequence[Sequence[str]], forces: bool) -> tuple[str, str]:
    """A built-in model and why.

    ``movements``: labels that are seen in each movement; those of standing where there is none. ``forces``:
    whether there are ground forces.
    """
    known = [
        {find_canonical(label) or strip_prefix(label).upper() for label in labels} for labels in movements
    ]
    common = set.intersection(*known) if known else set()
    whole = [m.name for m in load_builtin(WHOLE).markers if m.weight > 0.0]
    share = sum(name in common for name in whole) / len(whole)
    if share >= LARGELY and not list_hidden_segments(load_builtin(WHOLE), common):
        return WHOLE, f"{share:.0%} of its markers are in every movement"
    footed = all(
        f"{side}HEE" in common and any(f"{side}{name}" in common for name in _FOREFOOT) for side in "RL"
    )
    if footed and forces:
        return (
            FEET,
            f"heels and toes have markers and there are force plates; trunk and arms: {share:.0%} of {WHOLE}",
        )
    return LEGS, "the legs, the safe choice"
