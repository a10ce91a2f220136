"""Which label is which marker, where further labels sit, and what the marker set means for each method."""

from __future__ import annotations

import re
from collections import Counter, abc
from dataclasses import dataclass
from typing import Any

from scaling_service.capabilities.intake import result as documents
from scaling_service.capabilities.motion.ranges import list_hidden_segments
from scaling_service.model.anatomy import marker_sets
from scaling_service.model.anatomy import markers as anatomy_markers
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.trial import Trial, is_unlabelled
from scaling_service.recording.identity import identify as identifying
from scaling_service.recording.identity.tracking import find_elsewhere

CONFIDENCE: abc.Mapping[str, float] = {
    "": 1.0,
    "prefix left out": 0.99,
    "capitals ignored": 0.95,
    "known alias": 0.9,
}
"""By what is left out of account in comparing names. Chosen: an order, not probabilities."""

AMBIGUOUS = 0.4  # chosen: of a marker that two labels fit equally well

FEWEST = 3  # markers without which a segment has no pose of its own
MEASURED = ("ASIS", "PSIS", "LFE", "MFE", "LM", "MM")  # without side: what legs and pelvis are sized by
SURE = 0.5  # of a label's segment: likelier than all others together

_MOST_OTHERS = 3

_SAID = (("femur", re.compile(r"THI")), ("tibia", re.compile(r"TIB|SHK|SHANK|LEG")))
"""Words in labels of tracking markers that no marker set knows, and where those sit."""

_JOINTS = (("knee", "LFE", "MFE", "knee_width", "thigh"), ("ankle", "LM", "MM", "ankle_width", "shank"))
"""Joint, its outer and inner landmark, the width between them, and what carries the marker of its plane."""

LEGS, FEET, WHOLE = "lower_limb_14dof", "lower_limb_feet_18dof", "full_body_35dof"

LARGELY = 0.9
"""Chosen: share of the whole body's markers that must be there; arms and trunk with fewer cost more than they
tell, and the legs are the safe choice."""

_FOREFOOT = ("TOE", "MT1", "MT5")


@dataclass(frozen=True, slots=True)
class _Choice:
    label: str
    confidence: float
    why: str
    source: str


def propose_markers(
    model: BodyModel,
    trials: abc.Mapping[str, Trial],
    document: abc.Mapping[str, str],
    laboratory: abc.Mapping[str, str],
    who: identifying.Identification,
) -> tuple[list[documents.MarkerProof], list[str]]:
    """A label for every marker of a model.

    ``trials``: name to recording, in one set of axes, m. ``document``: model marker to label, as the
    subject's document says. ``laboratory``: label to model marker, as the laboratory has them. ``who``: what
    geometry tells of the labels. Returns ``unused``: labels that no marker took.
    """
    labels = list(dict.fromkeys(label for trial in trials.values() for label in trial.labels))
    wanted = [m.name for m in model.markers if m.weight > 0.0]
    offers = {marker: list(_by_name(marker, labels, document, laboratory)) for marker in wanted}
    # The surest offers first; no label is used twice. Of two equally sure ones, the first, less sure.
    taken: dict[str, _Choice] = {}
    given: set[str] = set()
    order = sorted(offers, key=lambda m: -max((c.confidence for c in offers[m]), default=0.0))
    for marker in order:
        free = sorted((c for c in offers[marker] if c.label not in given), key=lambda c: -c.confidence)
        if not free:
            continue
        best = free[0]
        rivals = [c.label for c in free[1:] if c.confidence == best.confidence]
        if rivals:
            why = f"{best.why}, but {' and '.join(rivals)} would fit as well"
            best = _Choice(best.label, AMBIGUOUS, why, best.source)
        taken[marker] = best
        given.add(best.label)
    # Labels that lie where a landmark is that sizes are measured by, if their names are not known to mean
    # anything else: a heel's marker lies near a malleolus that nobody marked. Others follow their segment as
    # the standing trial shows them: they may be anywhere on it.
    missing = [m for m in wanted if m not in taken]
    placed = {c.label for c in taken.values()}
    landmarks = {
        name: marker
        for marker in missing
        if (name := anatomy_markers.find_canonical(marker)) is not None and name[1:] in MEASURED
    }
    taken |= {
        landmarks[one.landmark]: _Choice(one.label, one.at_landmark, f"{one.why}: check it", "place")
        for one in who.labels.values()
        if one.landmark in landmarks
        and one.label not in placed
        and anatomy_markers.look_up_meaning(one.label) is None
    }
    used = {choice.label for choice in taken.values()}
    unused = [label for label in labels if label not in used]
    entries = [_make_entry(model, marker, taken.get(marker), offers[marker], trials) for marker in wanted]
    return entries, unused


def _by_name(
    marker: str, labels: abc.Sequence[str], document: abc.Mapping[str, str], laboratory: abc.Mapping[str, str]
) -> abc.Iterator[_Choice]:
    for label in labels:
        plain = anatomy_markers.strip_prefix(label)
        if document.get(marker) in (label, plain):
            yield _Choice(label, 1.0, "as the subject's document says", "document")
        elif laboratory.get(label, laboratory.get(plain)) == marker:
            yield _Choice(label, 0.99, "as the laboratory's map says", "laboratory")
        elif (reason := anatomy_markers.describe_likeness(label, marker)) is not None:
            yield _Choice(label, CONFIDENCE[reason], reason or "the same name", "name")


def _make_entry(
    model: BodyModel,
    name: str,
    choice: _Choice | None,
    offers: abc.Sequence[_Choice],
    trials: abc.Mapping[str, Trial],
) -> documents.MarkerProof:
    marker = model.marker(name)
    others = [o for o in offers if choice is None or o.label != choice.label]
    return documents.MarkerProof.model_validate(
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
                documents.Candidate(label=o.label, confidence=o.confidence, why=o.why)
                for o in others[:_MOST_OTHERS]
            ],
        }
    )


def identify_labels(
    trials: abc.Mapping[str, Trial],
    static: str | None,
    stature: float | None,
    document: abc.Mapping[str, str],
    laboratory: abc.Mapping[str, str],
) -> identifying.Identification:
    """What geometry tells of the labels; known names, and what somebody mapped, are taken for granted.

    ``document``: model marker to label. ``laboratory``: label to model marker.
    """
    standing = trials.get(static or "")
    if standing is None:
        return identifying.identify(None, ())
    mapped = {label: marker for marker, label in document.items()} | dict(laboratory)
    told: dict[str, str] = {}
    for label in standing.labels:
        marker = mapped.get(label, mapped.get(anatomy_markers.strip_prefix(label), label))
        landmark = anatomy_markers.find_canonical(marker)
        if (
            landmark is not None
            and landmark not in told.values()
            and not anatomy_markers.is_computed(anatomy_markers.strip_prefix(label))
        ):
            told[label] = landmark
    return identifying.identify(
        standing, [t for name, t in trials.items() if name != static], stature=stature, landmarks=told
    )


def assign_extra_markers(
    unused: abc.Sequence[str], who: identifying.Identification, model: BodyModel
) -> list[documents.ExtraMarker]:
    """The segment of each further label: as its marker set says, unless geometry tells another.

    ``unused``: labels that no marker took; points that software computed are left out.
    """
    known = marker_sets.assign_tracking_segments(unused, model)
    known = {label: s for label, s in known.items() if label not in find_elsewhere(known, model, who)}
    # A model's own segment for one of the whole body; None where it has none of that name.
    return [
        documents.ExtraMarker(
            label=label,
            segment=known.get(label)
            or (
                None
                if found is None
                else next((s for s in model.segment_names if found.segment in (s, model.bone_of(s))), None)
            ),
            confidence=1.0 if label in known else 0.0 if found is None else round(found.confidence, 3),
            why="as its marker set says" if label in known else "" if found is None else found.why,
        )
        for label in unused
        if not anatomy_markers.is_computed(label) and not is_unlabelled(label)
        for found in (who.labels.get(label),)
    ]


def find_sacral_label(
    markers: abc.Sequence[documents.MarkerProof], who: identifying.Identification
) -> dict[str, str]:
    """The sacral marker to its label, where that stands for both PSIS and its name does not say so."""
    if any(
        m.label is not None for m in markers if anatomy_markers.find_canonical(m.marker) in ("RPSIS", "LPSIS")
    ):
        return {}
    sacral = (
        one.label
        for one in who.labels.values()
        if one.landmark == anatomy_markers.SACRUM
        and one.at_landmark > SURE
        and anatomy_markers.find_canonical(one.label) != anatomy_markers.SACRUM
    )
    return {anatomy_markers.SACRUM: label for label in sacral}  # noqa: B035 (one label lies there at most)


def with_extra_markers(
    proposed: abc.Mapping[str, Any],
    model: BodyModel,
    markers: abc.Sequence[documents.MarkerProof],
    extra: abc.Sequence[documents.ExtraMarker],
    trials: abc.Mapping[str, Trial],
) -> dict[str, Any]:
    """A subject document with tracking markers, where it names none itself.

    Those that their marker set knows; and on a segment that the movements would show by fewer than three
    markers, all that geometry puts there. Only labels that are seen in a movement, and while standing, which
    places them, where anybody stands.

    ``trials``: file to recording.
    """
    static = trials.get(str(proposed["trials"].get("static")))
    if proposed.get("extra_markers"):
        return dict(proposed)
    others = [
        t
        for file, t in trials.items()
        if t is not static
        and any(file in proposed["trials"].get(role, ()) for role in ("calibration", "evaluation"))
    ]
    moving = {label for trial in others for label in trial.shown_labels}
    if static is not None:
        moving &= set(static.shown_labels)
    known = marker_sets.assign_tracking_segments([e.label for e in extra if e.label in moving], model)
    shown = Counter([m.segment for m in markers if m.label in moving] + list(known.values()))
    found = {
        e.label: e.segment
        for e in extra
        if e.segment is not None
        and e.label in moving
        and (e.label in known or (shown[e.segment] < FEWEST and e.confidence > SURE))
    }
    renamed = {anatomy_markers.strip_prefix(label): segment for label, segment in found.items()}
    return {**proposed, **({"extra_markers": renamed} if renamed else {})}


def guess_segment(label: str) -> str | None:
    """The segment that a label's words tell.

    Examples
    --------
    >>> guess_segment("RTHI"), guess_segment("S01:L_tib2"), guess_segment("C7")
    ('femur_r', 'tibia_l', None)
    """
    plain = anatomy_markers.strip_prefix(label).upper()
    segment = next((name for name, pattern in _SAID if pattern.search(plain)), None)
    return f"{segment}_{plain[0].lower()}" if segment is not None and plain[0] in "RL" else None


def check_marker_set(labels: abc.Sequence[str]) -> documents.MarkerSetProof | None:
    """The set that all labels together are closest to."""
    found = marker_sets.recognise(labels)
    if found is None:
        return None
    return documents.MarkerSetProof(
        name=found.name,
        title=found.title,
        share=round(found.share, 3),
        lacks=list(found.lacks),
        additions=list(found.additions),
    )


def describe_consequences(labels: abc.Sequence[str], sizes: documents.SizesProof) -> abc.Iterator[str]:
    """What landmarks that are missing mean for scaling.

    ``labels``: of all recordings.
    """
    there = {anatomy_markers.find_canonical(label) for label in labels}
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
        known = [f"{width}_{side.lower()}" for side in sides]
        measured = [f"{sizes.sizes_mm[name]:g}" for name in known if name in sizes.sizes_mm]
        planes = [
            marker_sets.find_plane_marker(
                labels, "knee" if joint == "knee" else "ankle", "r" if s == "R" else "l"
            )
            for s in sides
        ]
        text = f"no inner {joint} marker: MB takes the joint's centre from the outer one and half its width"
        text += f" ({' and '.join(measured)} mm)" if len(measured) == len(known) else ""
        if all(planes):
            text += f", in the plane of the {segment}'s marker ({', '.join(p for p in planes if p)})"
        if len(measured) < len(known):
            missing = ", ".join(f"{name}_mm: …" for name in known if name not in sizes.sizes_mm)
            text += f"; the width is not known: measure it and give `sizes: {{{missing}}}`"
        yield text
    if unsure:
        yield (
            "MB_lam and MB_am: without an inner knee marker hip rotation and the knee's axis are hardly "
            "determined; a movement that bends the knees, or a static trial with inner markers, tells more"
        )
        yield "EB and EB_am take the knee's centre and axis from the bones, where there are any"


def choose_model(
    movements: abc.Sequence[abc.Sequence[str]], forces: bool, who: identifying.Identification
) -> tuple[str, str]:
    """A built-in model and why.

    ``movements``: labels that are seen in each movement; those of standing where there is none. ``forces``:
    whether there are ground forces. ``who``: what geometry tells of the labels.
    """
    names = {
        one.label: one.landmark
        for one in who.labels.values()
        if one.landmark is not None and one.landmark[1:] in MEASURED and one.at_landmark > SURE
    }
    known = [
        {
            names.get(label)
            or anatomy_markers.find_canonical(label)
            or anatomy_markers.strip_prefix(label).upper()
            for label in labels
        }
        for labels in movements
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
