"""What a folder's recordings give cause to correct, and what loading warns of, each with its remedy."""

from __future__ import annotations

from collections import abc

import numpy as np

from scaling_service.capabilities.intake import result as documents
from scaling_service.capabilities.intake import standing
from scaling_service.capabilities.intake.files import RecordingFile
from scaling_service.capabilities.intake.roles import choose_static
from scaling_service.capabilities.intake.tables import OFFSET_N, describe_plates
from scaling_service.core.names import say_name
from scaling_service.core.notes import Note
from scaling_service.core.text import list_few
from scaling_service.files.table_files import list_plates
from scaling_service.model.anatomy.anthropometry import predict_dimensions
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import Trial, is_unlabelled
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.wrench import GRAVITY
from scaling_service.recording import plausibility
from scaling_service.recording.exchanged import Exchange
from scaling_service.recording.findings import Finding
from scaling_service.recording.identity.identify import MOST_LABELS
from scaling_service.recording.plates_feet import say_where
from scaling_service.recording.sizes import DEVIATIONS

Roles = abc.Mapping[str, tuple[str, str]]

_REPAIRS = {
    "spikes": "Check the plate's cable and amplifier; the forces are used as interpolated",
    "saturated": "Choose a larger range of the plate's amplifier; until then its highest forces are left out",
    "dead_channel": "Repair the plate; until then no forces of this recording are to be trusted",
}

ONE_FOOT = 0.5  # share of a person that plates bear where the other foot stands beside them

_LATE_S = 0.1  # chosen: other clocks and rounding


def check_standing(
    roles: Roles, trials: abc.Mapping[str, Trial], *, wanted: bool
) -> abc.Iterator[documents.ProblemEntry]:
    """That nobody stands still, or that who stands wears other markers than who moves.

    ``roles``, ``trials``: by file. ``wanted``: whether standing is missed: not where the user named the
    trials and left it out.
    """
    static = choose_static(roles)
    moving = {file: trial for file, trial in trials.items() if file != static and file in roles}
    if static is None and moving and wanted:
        yield _make_warning(
            "nobody stands still in any recording: segments are measured on the movements, where skin "
            "slides, and tracking markers are placed there, too",
            "Record a few seconds of standing with all markers, or name such a recording",
            field="trials.static",
        )
    if static is None or static not in trials:
        return
    ratio = standing.compare_pelvis(trials[static], list(moving.values()))
    if abs(ratio - 1.0) > standing.ANOTHER_PELVIS:
        size = "wider" if ratio > 1.0 else "narrower"
        yield _make_warning(
            f"the pelvis is {abs(ratio - 1.0):.0%} {size} than in the movements: it was recorded on another "
            "day or with other markers, or is another person",
            "Use a static trial of the same session; without one, leave `trials.static` out, so that the "
            "movements are measured",
            file=static,
            field="trials.static",
        )


def check_units(recordings: abc.Sequence[RecordingFile]) -> abc.Iterator[documents.ProblemEntry]:
    """Recordings whose unit of length cannot be true."""
    for item in recordings:
        for repair in (r for r in item.axes.repairs if r.what == "unit"):
            remedy = "Export it again with the right unit; the markers are used as corrected"
            if item.forces is not None:
                remedy += ", but its force plates cannot be placed until then"
            yield _make_warning(repair.detail, remedy, file=item.file, field="Units")


def check_labels(recordings: abc.Sequence[RecordingFile]) -> abc.Iterator[documents.ProblemEntry]:
    """More labels than a person carries; trajectories without one, with the markers whose gaps they fill."""
    for item in recordings:
        named = sum(not is_unlabelled(label) for label in item.trial.labels)
        if named > MOST_LABELS:
            yield _make_warning(
                f"it has {named:,} labels, more than one person carries: where they are does not tell whose",
                "Export the markers of one person",
                file=item.file,
                field="labels",
            )
        found = sorted(
            plausibility.find_unlabelled(item.trial.with_unlabelled()), key=lambda n: (-n.filled, -n.frames)
        )
        filling = [f"{n.label} fills {n.filled} frames of {n.fills}" for n in found if n.fills is not None]
        if found:
            names = list_few([n.label for n in found])
            count = "a trajectory has" if len(found) == 1 else f"{len(found)} trajectories have"
            yield _make_warning(
                f"{count} no label: {names}{f'; {list_few(filling)}' if filling else ''}",
                "Label them where they fill gaps; else nothing is to be done",
                file=item.file,
                corrections=[_fill(item, n) for n in found if n.fills is not None],
            )


def _fill(item: RecordingFile, found: plausibility.Unlabelled) -> documents.CorrectionEntry:
    """The trajectory that nobody labelled, as the marker whose gaps it fills."""
    trial = item.trial.with_unlabelled()
    seen = trial.times[find_seen(trial.position(found.label))]
    return documents.CorrectionEntry(
        file=item.file,
        labels={found.label: found.fills or ""},
        from_s=round(float(seen[0]), 4),
        to_s=round(float(seen[-1]), 4),
    )


def tell_findings(
    findings: abc.Sequence[Finding], trials: abc.Mapping[str, Trial]
) -> abc.Iterator[documents.ProblemEntry]:
    """What recordings show that a sound person does not, with the corrections that solve it.

    ``trials``: by file, with the files' own labels.
    """
    files = {trial.name: file for file, trial in trials.items()}
    for one in findings:
        file = files.get(one.place, one.place)
        offers = {one.place: one.exchanges, **one.rivals}
        yield documents.ProblemEntry(
            severity="error" if one.severity == "refusal" else "warning",
            file=file,
            field=", ".join(one.labels[:4]) or None,
            problem=one.problem,
            remedy=one.remedy,
            corrections=[
                entry
                for name, exchanges in offers.items()
                for exchange in exchanges
                if name in files
                and (entry := _make_correction(files[name], exchange, trials[files[name]])) is not None
            ],
        )


def _make_correction(file: str, wrong: Exchange, trial: Trial) -> documents.CorrectionEntry | None:
    """The exchange with the file's own labels; None where it cannot be told which these are."""
    own = {label: label for label in trial.labels}
    for label in trial.labels:
        own.setdefault(find_canonical(label) or label, label)
    if any(label not in own for label in wrong.labels):
        return None
    labels = {own[label]: own[true] for label, true in zip(wrong.labels, wrong.true, strict=True)}
    return documents.CorrectionEntry(
        file=file, labels=labels, from_s=round(wrong.start_s, 4), to_s=round(wrong.end_s, 4)
    )


def check_plates(recordings: abc.Sequence[documents.RecordingProof]) -> abc.Iterator[documents.ProblemEntry]:
    """Plates that read something while nobody is near them, each once for all recordings."""
    offsets: dict[str, dict[str, float]] = {}
    for recording in recordings:
        for plate in recording.plates:
            if plate.offset_N is not None and abs(plate.offset_N) > OFFSET_N:
                file = recording.forces_from or recording.file
                offsets.setdefault(plate.name, {})[file] = plate.offset_N
    for name, found in offsets.items():
        low, high = (f"{value:.0f}" for value in (min(found.values()), max(found.values())))
        yield _make_warning(
            f"{say_name(name)} reads {low if low == high else f'{low} to {high}'} N while no foot is near it",
            "Zero the plate before recording, or subtract this offset: else it loads the person",
            file=list_few(list(found)),
        )


def check_weight(
    ground: abc.Mapping[str, GroundForces], trials: abc.Mapping[str, Trial], sizes: documents.SizesProof
) -> abc.Iterator[documents.ProblemEntry]:
    """Plates on which feet stand and that never bear what a person weighs.

    ``ground``, ``trials``: by file, at the same times. Forces as small as noise are asked where they would
    press if they bore the person: under a foot, they are in another unit.
    """
    people = predict_dimensions(sex=sizes.sex, height_m=sizes.height_m, mass_kg=sizes.mass_kg)
    usual, sd = people.value("mass"), people.sd("mass")
    heaviest = {
        file: float(np.nansum(forces.pressing.clip(0.0), axis=1).max()) / -GRAVITY[1]
        for file, forces in ground.items()
    }
    most = max(heaviest.values(), default=0.0)
    if not 0.0 < most < ONE_FOOT * usual * np.exp(-DEVIATIONS * sd / usual):
        return
    standing = []
    for file, forces in ground.items():
        factor = usual / most
        as_person = forces.change(force=factor * forces.force, moment=factor * forces.moment)
        contacts = describe_plates(list_plates(as_person, None), as_person, trials[file], ())[1]
        if any(contact.who for contact in contacts):
            standing.append(file)
    if standing:
        yield _make_warning(
            f"feet stand on the plates, which bear {most:.2g} kg at most: nobody weighs so little",
            "Give forces in N: kN, kilograms, pounds and body weights are other units. Until then no force "
            "of this session is to be trusted",
            file=list_few(standing),
        )


def check_faults(recordings: abc.Sequence[documents.RecordingProof]) -> abc.Iterator[documents.ProblemEntry]:
    """What plates did wrong, as their readings alone show; loading tells the same of markers."""
    for recording in recordings:
        for repair in recording.repairs:
            if repair.what in _REPAIRS:
                yield _make_warning(
                    f"{say_where(repair.what, repair.where)}: {repair.detail} ({repair.frames} frames)",
                    _REPAIRS[repair.what],
                    file=recording.forces_from,
                )


def check_times(
    recordings: abc.Sequence[documents.RecordingProof], spans: abc.Mapping[str, tuple[float, float]]
) -> abc.Iterator[documents.ProblemEntry]:
    """Files of forces that do not cover the recording that they are for."""
    for recording in recordings:
        source = recording.forces_from
        if source is None or source == recording.file or source not in spans:
            continue
        first, last = recording.start_s, recording.start_s + (recording.frames - 1) / recording.rate_hz
        begins, ends = spans[source]
        if begins > first + _LATE_S or ends < last - _LATE_S:
            yield _make_warning(
                f"it covers {begins:.2f} to {ends:.2f} s, but {recording.file} lasts from {first:.2f} to "
                f"{last:.2f} s",
                "Check that it belongs to this recording; frames without forces are left out of dynamics",
                file=source,
                field=f"forces.{recording.file}",
            )


def check_unused_forces(
    files: abc.Sequence[documents.FileRole], recordings: abc.Sequence[documents.RecordingProof]
) -> abc.Iterator[documents.ProblemEntry]:
    """Files of forces that belong to no recording, while some movement has no forces."""
    moving = ("trials.calibration", "trials.evaluation")
    used_as = {file.name: file.role for file in files}
    bare = [r.file for r in recordings if used_as.get(r.file) in moving and r.force is None]
    unused = [f.name for f in files if f.kind == "forces" and f.role is None and f.problem is None]
    for name in unused if bare else ():
        yield _make_warning(
            f"nothing says which recording these forces belong to, and there are none for {list_few(bare)}",
            "Choose the recording that was made with them",
            file=name,
            field="forces",
        )


def _make_warning(
    problem: str,
    remedy: str,
    file: str | None = None,
    field: str | None = None,
    corrections: abc.Sequence[documents.CorrectionEntry] = (),
) -> documents.ProblemEntry:
    return documents.ProblemEntry(
        severity="warning",
        file=file,
        field=field,
        problem=problem,
        remedy=remedy,
        corrections=list(corrections),
    )


def tell_notes(notes: abc.Iterable[Note]) -> abc.Iterator[documents.ProblemEntry]:
    """What loading says, each with its remedy."""
    for note in notes:
        severity: documents.Severity = "note" if note.severity == "note" else "warning"
        yield documents.ProblemEntry(severity=severity, problem=note.statement, remedy=note.remedy)
