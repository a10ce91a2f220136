"""Labels under the model's marker names: what the subject file maps, known aliases, tracking markers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from scaling_service.capabilities.subject.reading import blame_file
from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.core.text import list_few, suggest_name
from scaling_service.model.anatomy.marker_sets import assign_tracking_segments
from scaling_service.model.anatomy.markers import LabelMap, is_computed, match_labels, strip_prefix
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Repair, Trial

_LIMBS = ("femur", "tibia")
_FEWEST = 3  # markers without which a segment has no pose of its own


def without_computed(model: BodyModel, subject: Subject) -> BodyModel:
    """The model with points that other software computes from markers (joint centres) not to be followed.

    They may still be measured by a scale set-up, and are markers again where the subject file maps them.
    """
    return model.with_markers(
        tuple(
            replace(m, weight=0.0) if is_computed(m.name) and m.name not in subject.marker_map else m
            for m in model.markers
        )
    )


def check_segments(subject: Subject, model: BodyModel) -> None:
    """Extra markers sit on segments of the model."""
    for label, segment in subject.extra_markers.items():
        if segment not in model.segment_names:
            raise SubjectInvalid(
                f"model '{model.name}' has no segment '{segment}'",
                field=f"extra_markers.{label}",
                remedy=f"{suggest_name(segment, model.segment_names)}Its segments are "
                f"{', '.join(model.segment_names)}",
            )


def check_explicit(subject: Subject, model: BodyModel, trials: Sequence[Trial]) -> None:
    """A marker that the subject file maps is the model's, and its label in at least one recording."""
    present = list(dict.fromkeys(label for trial in trials for label in trial.labels))
    for marker, label in subject.marker_map.items():
        if marker not in model.marker_names and marker not in subject.extra_markers:
            raise SubjectInvalid(
                f"the model has no marker '{marker}'",
                field=f"markers.{marker}",
                remedy=f"{suggest_name(marker, model.marker_names)}It has {', '.join(model.marker_names)}",
            )
        if not _has(present, label):
            raise SubjectInvalid(
                f"label '{label}' is in no recording",
                field=f"markers.{marker}",
                remedy=f"{suggest_name(label, [strip_prefix(p) for p in present])}Their labels are "
                f"{', '.join(present)}",
            )


def with_tracking_markers(
    subject: Subject, model: BodyModel, trials: Mapping[Path, Trial]
) -> tuple[Subject, tuple[str, ...]]:
    """The subject with tracking markers of its marker set on thighs and shanks that movements hardly show.

    A segment with fewer than three markers has no pose of its own; where the subject file names no extra
    markers, those whose place the set tells are taken. Only for built-in models: others bring their own.
    """
    if subject.extra_markers or subject.model not in BUILTIN_NAMES:
        return subject, ()
    moving = [trial for path, trial in trials.items() if path != subject.static] or list(trials.values())
    labels = set(moving[0].labels).intersection(*(trial.labels for trial in moving[1:]))
    matched = match_labels(sorted(labels), model.marker_names, _list_explicit(subject, labels)).mapped
    carried = Counter(m.segment for m in model.markers if m.name in matched and m.weight > 0.0)
    known = assign_tracking_segments(sorted(labels - set(matched.values())), model)
    added = {
        strip_prefix(label): segment
        for label, segment in known.items()
        if segment.startswith(_LIMBS) and carried[segment] < _FEWEST
    }
    if not added:
        return subject, ()
    names = list_few(list(added))
    note = f"{names}: tracking markers of this marker set, used though no extra_markers name them"
    return replace(subject, extra_markers=added), (note,)


def with_model_names(
    trial: Trial, wanted: Sequence[str], subject: Subject, path: Path
) -> tuple[Trial, Mapping[str, str]]:
    """A trial with the model's names in place of its labels, and which label was taken for which marker."""
    explicit = _list_explicit(subject, trial.labels)
    with blame_file(path):
        found = match_labels(trial.labels, wanted, explicit)
        _refuse_rivals(found, explicit)
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


def _refuse_rivals(found: LabelMap, explicit: Mapping[str, str]) -> None:
    """The same label with and without a prefix, or with two: they may be of two persons."""
    for marker, label in found.mapped.items():
        rivals = [other for other in found.unused_labels if strip_prefix(other) == strip_prefix(label)]
        if rivals and marker not in explicit:
            raise InputError(
                f"marker '{marker}' could be {' or '.join(repr(name) for name in (label, *rivals))}",
                field=f"markers.{marker}",
                remedy="Say under `markers:` in the subject file which label it is",
            )


def _list_explicit(subject: Subject, labels: Iterable[str]) -> dict[str, str]:
    return {m: label for m, label in subject.marker_map.items() if _has(list(labels), label)}


def _has(labels: Sequence[str], label: str) -> bool:
    return label in labels or label in map(strip_prefix, labels)


def sort_by_segment(model: BodyModel, subject: Subject) -> dict[str, tuple[str, ...]]:
    """Segment to the labels on it, from which gaps of the others can be filled."""
    found: dict[str, list[str]] = {segment: [] for segment in model.segment_names}
    sides = {m.name: m.segment for m in model.markers if m.weight > 0.0} | dict(subject.extra_markers)
    for label, segment in sides.items():
        found[segment].append(label)
    return {segment: tuple(labels) for segment, labels in found.items() if labels}


def list_used_labels(maps: Sequence[Mapping[str, str]], wanted: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Model marker to the labels that were taken for it in the recordings."""
    every = {name: tuple(dict.fromkeys(m[name] for m in maps if name in m)) for name in wanted}
    return {name: labels for name, labels in every.items() if labels}
