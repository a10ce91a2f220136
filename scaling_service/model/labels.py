"""Labels of recordings under a model's marker names: what the subject file maps, and known aliases."""

from __future__ import annotations

from collections import abc
from dataclasses import replace
from pathlib import Path

from scaling_service.core import errors, text
from scaling_service.model.anatomy import markers
from scaling_service.model.anatomy.rotations import match_rotation
from scaling_service.model.body import BodyModel
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Repair, Trial


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


def check_explicit(subject: Subject, model: BodyModel, labels: abc.Iterable[str]) -> None:
    """A marker that the subject file maps is the model's, and its label in at least one recording.

    ``labels``: of all recordings.
    """
    present = list(dict.fromkeys(labels))
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


def with_model_names(
    trial: Trial, wanted: abc.Sequence[str], subject: Subject, path: Path
) -> tuple[Trial, abc.Mapping[str, str]]:
    """A trial with the model's names in place of its labels, and which label was taken for which marker."""
    explicit = list_explicit(subject, trial.labels)
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
    notes = [Repair("label", path.name, note) for note in found.notes]
    notes += [
        Repair("label", label, f"'{label}' was left out: the marker is another label") for label in shadowed
    ]
    renamed = kept.relabel(found.renames)
    return replace(renamed, repairs=(*renamed.repairs, *notes)), found.mapped


def list_explicit(subject: Subject, labels: abc.Iterable[str]) -> dict[str, str]:
    """Model marker to label, as the subject file maps them, of those among some labels."""
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
