"""Tracking markers on thighs and shanks that the subject file does not name, and those that sit elsewhere."""

from __future__ import annotations

from collections import Counter, abc
from dataclasses import replace

from scaling_service.core import text
from scaling_service.core.names import say_name
from scaling_service.core.notes import Note
from scaling_service.model.anatomy import markers
from scaling_service.model.anatomy.marker_sets import assign_tracking_segments
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.labels import list_explicit
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Trial
from scaling_service.recording import orientation
from scaling_service.recording.identity.identify import Identification, Identity, identify

_LIMBS = ("femur", "tibia")
_SURE = 0.5  # of a label's segment: likelier than all others together
_CERTAIN = 0.9  # of a label's segment: none of 766 labels of 11 persons was wrong above it
_FEWEST = 3  # markers without which a segment has no pose of its own


def with_tracking_markers(
    subject: Subject,
    model: BodyModel,
    shown: abc.Sequence[Trial],
    ask: abc.Callable[[], Identification],
) -> tuple[Subject, tuple[Note, ...]]:
    """The subject with tracking markers on thighs and shanks that movements hardly show.

    A segment with fewer than three markers has no pose of its own; where the subject file names no extra
    markers, those that the marker set puts there are taken, and those that sit there and move with it, which
    takes two markers. Only for built-in models: others bring their own. Those that sit on another segment
    than is said, and move with it, are told; where only their name said it, they are left out.

    ``shown``: the movements, or the standing one alone. ``ask``: what geometry tells of the labels, asked
    where names do not suffice, for it takes its time.
    """
    if subject.extra_markers:
        return subject, tuple(_tell_elsewhere(find_elsewhere(subject.extra_markers, model, ask())))
    if subject.model not in BUILTIN_NAMES:
        return subject, ()
    first, *others = shown
    labels = set(first.labels).intersection(*(trial.labels for trial in others))
    explicit = list_explicit(subject, labels)
    matched = markers.match_labels(sorted(labels), model.marker_names, explicit).mapped
    carried = Counter(m.segment for m in model.markers if m.name in matched and m.weight > 0.0)
    limbs = {s for s in model.segment_names if s.startswith(_LIMBS) and carried[s] < _FEWEST}
    free = sorted(labels - set(matched.values()))
    if not limbs or not free:
        return subject, ()
    who = ask()
    by_set = {n: s for n, s in assign_tracking_segments(free, model).items() if s in limbs}
    elsewhere = find_elsewhere(by_set, model, who)
    by_set = {label: segment for label, segment in by_set.items() if label not in elsewhere}
    still = {s for s in limbs if carried[s] + Counter(by_set.values())[s] < _FEWEST}
    by_place = {
        one.label: one.segment
        for one in who.labels.values()
        if one.label in free and one.label not in by_set
        if one.segment in still and one.confidence > _SURE
    }
    together = carried + Counter([*by_set.values(), *by_place.values()])
    by_place = {label: segment for label, segment in by_place.items() if together[segment] > 1}
    notes = [
        Note(
            code="tracking",
            severity="note",
            problem=f"{text.list_few(list(found))}: {why}, used though no extra_markers name them",
            remedy="Nothing is to be done; name them under `extra_markers:` to decide it yourself",
        )
        for found, why in (
            (by_set, "tracking markers of this marker set"),
            (by_place, "they sit on thighs and shanks and move with them"),
        )
        if found
    ]
    added = {markers.strip_prefix(label): segment for label, segment in (by_set | by_place).items()}
    notes += _tell_elsewhere(elsewhere)
    return (replace(subject, extra_markers=added) if added else subject), tuple(notes)


def ask_geometry(
    standing: Trial | None, movements: abc.Sequence[Trial], stature: float | None
) -> Identification:
    """What geometry tells of the labels, known names taken for granted."""
    if standing is None:
        return identify(None, ())
    found = ((label, markers.find_canonical(label)) for label in standing.labels)
    told = {label: role for label, role in found if role is not None}
    return identify(
        orientation.apply(orientation.decide(standing, roles=told), standing),
        movements,
        stature=stature,
        landmarks={label: name for label, name in told.items() if list(told.values()).count(name) == 1},
    )


def find_elsewhere(
    said: abc.Mapping[str, str], model: BodyModel, who: Identification
) -> dict[str, tuple[str, Identity]]:
    """Labels said to be on thighs and shanks that geometry puts on another of them: said, and what it is."""
    return {
        label: (segment, one)
        for label, segment in said.items()
        for one in who.labels.values()
        if label in (one.label, markers.strip_prefix(one.label)) and one.confidence > _CERTAIN
        if one.segment is not None and one.segment.startswith(_LIMBS)
        if model.bone_of(segment).startswith(_LIMBS) and one.segment not in (segment, model.bone_of(segment))
    }


def _tell_elsewhere(elsewhere: abc.Mapping[str, tuple[str, Identity]]) -> abc.Iterator[Note]:
    for label, (segment, one) in elsewhere.items():
        yield Note(
            code="elsewhere",
            place=label,
            problem=f"it is said to be on the {say_name(segment)}, and by where it stands and how it moves "
            f"it is on the {say_name(one.segment or '')}: {one.why}",
            remedy=f"Give it as one of `{one.segment}` under `extra_markers:`, or leave it out",
        )
