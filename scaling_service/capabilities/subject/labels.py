"""Labels under the model's marker names: what the subject file maps, known aliases, tracking markers."""

from __future__ import annotations

from collections import Counter, abc
from dataclasses import replace
from pathlib import Path

from scaling_service.core import errors, text
from scaling_service.core.notes import Note
from scaling_service.model.anatomy import markers
from scaling_service.model.anatomy.marker_sets import assign_tracking_segments
from scaling_service.model.anatomy.rotations import match_rotation
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Repair, Trial
from scaling_service.recording import orientation
from scaling_service.recording.identity import identify as identifying

_LIMBS = ("femur", "tibia")
_SURE = 0.5  # of a label's segment: likelier than all others together
_CERTAIN = 0.9  # of a label's segment: none of 766 labels of 11 persons was wrong above it
_FEWEST = 3  # markers without which a segment has no pose of its own


def without_computed(model: BodyModel, subject: Subject) -> BodyModel:
    """The model with points that other software computes from markers (joint centres) not to be followed.

    They may still be measured by a scale set-up, and are markers again where the subject file maps them.
    """
    return model.with_markers(
        tuple(
            replace(m, weight=0.0) if markers.is_computed(m.name) and m.name not in subject.marker_map else m
            for m in model.markers
        )
    )


def check_segments(subject: Subject, model: BodyModel) -> None:
    """Extra markers sit on segments of the model."""
    for label, segment in subject.extra_markers.items():
        if segment not in model.segment_names:
            raise errors.SubjectInvalid(
                f"model '{model.name}' has no segment '{segment}'",
                field=f"extra_markers.{label}",
                remedy=f"{text.suggest_name(segment, model.segment_names)}Its segments are "
                f"{', '.join(model.segment_names)}",
            )


def check_explicit(subject: Subject, model: BodyModel, trials: abc.Sequence[Trial]) -> None:
    """A marker that the subject file maps is the model's, and its label in at least one recording."""
    present = list(dict.fromkeys(label for trial in trials for label in trial.labels))
    for marker, label in subject.marker_map.items():
        if marker not in (*model.marker_names, *subject.extra_markers, markers.SACRUM):
            raise errors.SubjectInvalid(
                f"the model has no marker '{marker}'",
                field=f"markers.{marker}",
                remedy=f"{text.suggest_name(marker, model.marker_names)}It has "
                f"{', '.join(model.marker_names)}",
            )
        if not _has(present, label):
            raise errors.SubjectInvalid(
                f"label '{label}' is in no recording",
                field=f"markers.{marker}",
                remedy=f"{text.suggest_name(label, [markers.strip_prefix(p) for p in present])}Their labels "
                f"are {', '.join(present)}",
            )


def with_tracking_markers(
    subject: Subject,
    model: BodyModel,
    standing: Trial | None,
    movements: abc.Sequence[Trial],
    who: identifying.Identification | None = None,
) -> tuple[Subject, tuple[Note, ...]]:
    """The subject with tracking markers on thighs and shanks that movements hardly show.

    A segment with fewer than three markers has no pose of its own; where the subject file names no extra
    markers, those that the marker set puts there are taken, and those that sit there and move with it, which
    takes two markers. Only for built-in models: others bring their own. Those that sit on another segment
    than is said, and move with it, are told; where only their name said it, they are left out. ``who``: what
    geometry tells, where it was asked already.
    """
    if subject.extra_markers:
        who = who or _identify(standing, movements, subject.height_m)
        return subject, tuple(_tell_elsewhere(find_elsewhere(subject.extra_markers, model, who)))
    if subject.model not in BUILTIN_NAMES:
        return subject, ()
    first, *others = movements or ([] if standing is None else [standing])
    labels = set(first.labels).intersection(*(trial.labels for trial in others))
    explicit = _list_explicit(subject, labels)
    matched = markers.match_labels(sorted(labels), model.marker_names, explicit).mapped
    carried = Counter(m.segment for m in model.markers if m.name in matched and m.weight > 0.0)
    limbs = {s for s in model.segment_names if s.startswith(_LIMBS) and carried[s] < _FEWEST}
    free = sorted(labels - set(matched.values()))
    by_set = {n: s for n, s in assign_tracking_segments(free, model).items() if s in limbs}
    who = who or _identify(standing, movements, subject.height_m) if by_set else who
    elsewhere = find_elsewhere(by_set, model, who)
    by_set = {label: segment for label, segment in by_set.items() if label not in elsewhere}
    still = {s for s in limbs if carried[s] + Counter(by_set.values())[s] < _FEWEST}
    by_place = _find_clusters(standing, movements, set(free) - by_set.keys(), still, subject.height_m, who)
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


def _identify(
    standing: Trial | None, movements: abc.Sequence[Trial], stature: float | None
) -> identifying.Identification | None:
    """What geometry tells of the labels, known names taken for granted; None where nobody stands."""
    if standing is None:
        return None
    found = ((label, markers.find_canonical(label)) for label in standing.labels)
    told = {label: role for label, role in found if role is not None}
    return identifying.identify(
        orientation.apply(orientation.decide(standing, roles=told), standing),
        movements,
        stature=stature,
        landmarks={label: name for label, name in told.items() if list(told.values()).count(name) == 1},
    )


def find_elsewhere(
    said: abc.Mapping[str, str], model: BodyModel, who: identifying.Identification | None
) -> dict[str, tuple[str, identifying.Identity]]:
    """Labels said to be on thighs and shanks that geometry puts on another of them: said, and what it is."""
    return {
        label: (segment, one)
        for label, segment in said.items()
        for one in (() if who is None else who.labels.values())
        if label in (one.label, markers.strip_prefix(one.label)) and one.confidence > _CERTAIN
        if one.segment is not None and one.segment.startswith(_LIMBS)
        if model.bone_of(segment).startswith(_LIMBS) and one.segment not in (segment, model.bone_of(segment))
    }


def _tell_elsewhere(
    elsewhere: abc.Mapping[str, tuple[str, identifying.Identity]],
) -> abc.Iterator[Note]:
    for label, (segment, one) in elsewhere.items():
        yield Note(
            code="elsewhere",
            place=label,
            problem=f"it is said to be on {segment}, and by where it stands and how it moves it is on "
            f"{one.segment}: {one.why}",
            remedy=f"Give it as one of {one.segment} under `extra_markers:`, or leave it out",
        )


def _find_clusters(
    standing: Trial | None,
    movements: abc.Sequence[Trial],
    free: set[str],
    limbs: set[str],
    stature: float | None,
    who: identifying.Identification | None,
) -> dict[str, str]:
    """Labels that geometry puts on segments, of those that no marker takes."""
    if not limbs or not free:
        return {}
    who = who or _identify(standing, movements, stature)
    return {
        one.label: one.segment
        for one in (() if who is None else who.labels.values())
        if one.label in free and one.segment in limbs and one.confidence > _SURE
    }


def with_model_names(
    trial: Trial, wanted: abc.Sequence[str], subject: Subject, path: Path
) -> tuple[Trial, abc.Mapping[str, str]]:
    """A trial with the model's names in place of its labels, and which label was taken for which marker."""
    explicit = _list_explicit(subject, trial.labels)
    found = markers.match_labels(trial.labels, wanted, explicit)
    # The same label with and without a prefix, or with two: they may be of two persons.
    for marker, label in found.mapped.items():
        rivals = [
            other
            for other in found.unused_labels
            if markers.strip_prefix(other) == markers.strip_prefix(label)
        ]
        if rivals and marker not in explicit:
            raise errors.InputError(
                f"marker '{marker}' could be {' or '.join(repr(name) for name in (label, *rivals))}",
                field=f"markers.{marker}",
                remedy="Say under `markers:` in the subject file which label it is",
            )
    # A label that happens to carry a marker's name, while the user mapped that marker to another one.
    shadowed = [label for label in found.unused_labels if label in found.mapped]
    kept = trial.select([label for label in trial.labels if label not in shadowed])
    notes = [Repair(what="label", where=path.name, detail=note) for note in found.notes]
    notes += [
        Repair(what="label", where=label, detail=f"'{label}' was left out: the marker is another label")
        for label in shadowed
    ]
    renamed = kept.relabel(found.renames)
    return replace(renamed, repairs=(*renamed.repairs, *notes)), found.mapped


def _list_explicit(subject: Subject, labels: abc.Iterable[str]) -> dict[str, str]:
    return {m: label for m, label in subject.marker_map.items() if _has(list(labels), label)}


def _has(labels: abc.Sequence[str], label: str) -> bool:
    return label in labels or label in map(markers.strip_prefix, labels)


def sort_by_segment(model: BodyModel, subject: Subject) -> dict[str, tuple[str, ...]]:
    """Segment to the labels on it, from which gaps of the others can be filled."""
    found: dict[str, list[str]] = {segment: [] for segment in model.segment_names}
    sides = {m.name: m.segment for m in model.markers if m.weight > 0.0} | dict(subject.extra_markers)
    for label, segment in sides.items():
        found[segment].append(label)
    return {segment: tuple(labels) for segment, labels in found.items() if labels}


def list_placed(model: BodyModel, subject: Subject, trials: abc.Iterable[Trial]) -> dict[str, str]:
    """Every marker that a recording shows, and every rotation that is measured, to its segment."""
    segments = {m.name: m.segment for m in model.markers} | dict(subject.extra_markers)
    given = list(trials)
    shown = {label for trial in given for label in trial.shown_labels}
    turned = {label for trial in given if trial.rotations is not None for label in trial.rotations.labels}
    on = {label: segment for label in sorted(turned) if (segment := match_rotation(label, model)) is not None}
    return on | {name: segment for name, segment in segments.items() if name in shown}
