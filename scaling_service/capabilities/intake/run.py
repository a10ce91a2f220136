"""A look at a subject's files before anything is computed: what they are, and what to correct."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.capabilities.intake import warnings
from scaling_service.capabilities.intake.document import (
    AxesEntry,
    FileRole,
    MarkerProof,
    ProblemEntry,
    ProofDocument,
    RecordingProof,
)
from scaling_service.capabilities.intake.files import Found, look_into
from scaling_service.capabilities.intake.marker_set import choose_model, consequences, marker_set_proof
from scaling_service.capabilities.intake.markers import extra_markers, propose, with_extra_markers
from scaling_service.capabilities.intake.proposal import (
    named_in,
    ordered,
    proposal,
    roles_of,
    sizes_proof,
    unknown_person,
    with_sizes,
)
from scaling_service.capabilities.intake.recordings import (
    Seen,
    axes_entry,
    problem_of,
    session_axes,
)
from scaling_service.capabilities.intake.roles import static_of
from scaling_service.capabilities.intake.tables import Ground, recording_proof
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.subject.checks import require_landmarks
from scaling_service.capabilities.subject.loading import load, read_model
from scaling_service.capabilities.subject.reading import subject_from_document
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import InputError
from scaling_service.core.text import few
from scaling_service.documents.reading import check_document
from scaling_service.documents.subject import MODEL_SUFFIXES
from scaling_service.files.recording import Recording
from scaling_service.files.table_files import ArrayFiles
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import builtin
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.masks import ever
from scaling_service.numerics.least_squares.masks import seen as seen_in
from scaling_service.recording.orientation import check_axes

Progress = Callable[[str, float], None]
"""Called with what is being done and the share of the whole that is done, 0 to 1."""

FOLDER = "proof"  # of the tables, below the job's files

_READ, _SHOWN = 0.5, 0.7  # chosen: about the shares of time
_SURE = 0.99  # by names alone, scaling finds the same


@dataclass(slots=True)
class _Sheet:
    """What is found on the way."""

    recordings: list[RecordingProof] = field(default_factory=list)
    trials: dict[str, Trial] = field(default_factory=dict)
    problems: list[ProblemEntry] = field(default_factory=list)
    axes: AxesEntry | None = None


def prove(
    folder: Path,
    document: Mapping[str, Any],
    outputs: Path,
    *,
    skip: Sequence[str] = (),
    labels: Mapping[str, str] | None = None,
    settings: Settings = Settings(),
    progress: Progress | None = None,
) -> ProofDocument:
    """Look at all files of a folder, tell what they are for, and what scaling would refuse.

    Parameters
    ----------
    folder : Path
    document : mapping
        The subject's document, or as much of it as there is: at least ``subject`` with its ``id``.
    outputs : Path
        Where tables are written, in the folder ``proof``.
    skip : sequence of str
        Files that are not looked at.
    labels : mapping, optional
        Label to model marker, as the laboratory has them.
    settings : Settings
    progress : callable, optional

    Raises
    ------
    InputError
        Only where the axes in the settings are none; what is wrong with files is in the result.
    """
    check_axes(settings.up, settings.forward)
    report = progress or _silent
    names = sorted(p.name for p in folder.iterdir() if p.is_file() and p.name not in skip)
    found: list[Found] = []
    for k, name in enumerate(names):
        report(f"reading {name}", _READ * k / len(names))
        found.append(look_into(folder / name, settings.up, settings.forward))
    known = _known(found, document)
    roles = roles_of(found, known)
    sheet = _Sheet(problems=[*_missing(known, names), *_folders(folder)])
    seen = [f.content for f in found if isinstance(f.content, Seen)]
    sizes = sizes_proof(known, seen)
    report("showing the recordings", _READ)
    _show(found, roles, settings, ArrayFiles(outputs, FOLDER), sheet)
    report("naming the markers", _SHOWN)
    usual, why = _usual(roles, sheet)
    model = _model(folder, known, roles, sheet, usual)
    standing = static_of(roles)
    markers, unused = propose(
        model,
        sheet.trials,
        sheet.trials.get(standing or "") or next(iter(sheet.trials.values()), None),
        known.get("markers") or {},
        labels or {},
    )
    proposed = proposal(known, found, roles, usual, _explicit(markers, known))
    if proposed is not None:
        proposed = ordered(with_sizes(with_extra_markers(proposed, model, unused, sheet.trials), sizes))
    report("asking what scaling would refuse", _SHOWN)
    sheet.problems += [*_compared(found, known, roles, seen, sheet), *unknown_person(sizes)]
    told = {warnings.exchange_in(problem) for problem in sheet.problems} - {None}
    read = {(folder / item.file).absolute(): item.trial for item in seen}
    refused = _refusals(folder, proposed, settings, read)
    sheet.problems += [p for p in refused if warnings.exchange_in(p) not in told]
    every = list(dict.fromkeys(label for trial in sheet.trials.values() for label in trial.labels))
    chosen = str(known.get("model") or (proposed or {}).get("model") or usual)
    return ProofDocument(
        subject=str(known["subject"]["id"]),
        model=chosen,
        model_why=why if chosen == usual and not known.get("model") else None,
        axes=sheet.axes,
        files=[_role(item, roles, known) for item in found],
        recordings=sheet.recordings,
        marker_set=marker_set_proof(every),
        consequences=list(consequences(every, sizes)),
        sizes=sizes,
        markers=markers,
        unused_labels=unused,
        extra_markers=extra_markers(markers, unused, sheet.trials, model),
        proposal=proposed,
        problems=sheet.problems,
    )


def _folders(folder: Path) -> Iterator[ProblemEntry]:
    """Folders inside, which are not looked at; those that this look has written are no matter."""
    inside = sorted(p.name for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    unread = [name for name in inside if any(p.is_file() for p in (folder / name).iterdir())]
    unread = [name for name in unread if not (folder / name / "proof.json").is_file()]
    if unread:
        yield ProblemEntry(
            severity="warning",
            problem=f"folders inside it are not looked at: {few(unread)}",
            remedy="Put their files beside the others if they belong to this person",
        )


def _usual(roles: Mapping[str, tuple[str, str]], sheet: _Sheet) -> tuple[str, str]:
    """The built-in model for these recordings, and why."""
    static = static_of(roles)
    moving = {file: trial for file, trial in sheet.trials.items() if file != static and file in roles}
    shown = [
        [trial.labels[k] for k in np.flatnonzero(ever(seen_in(trial.markers)))]
        for trial in (moving or sheet.trials).values()
    ]
    return choose_model(shown, any(recording.plates for recording in sheet.recordings))


def _compared(
    found: Sequence[Found],
    known: Mapping[str, Any],
    roles: Mapping[str, tuple[str, str]],
    seen: Sequence[Seen],
    sheet: _Sheet,
) -> Iterator[ProblemEntry]:
    """What the recordings, compared with each other and with their forces, give cause to correct."""
    spans = {
        f.name: (float(f.content.times[0]), float(f.content.times[-1]))
        for f in found
        if isinstance(f.content, GroundForces)
    }
    yield from warnings.of_standing(roles, sheet.trials, wanted=not known.get("trials"))
    yield from warnings.of_units(seen)
    yield from warnings.of_labels(seen)
    yield from warnings.of_exchanges(sheet.trials)
    yield from warnings.of_times(sheet.recordings, spans)
    yield from warnings.of_plates(sheet.recordings)


def _known(found: Sequence[Found], document: Mapping[str, Any]) -> dict[str, Any]:
    """The document; while it names no recordings, with what a subject file among the files says."""
    file = next((f.content for f in found if f.kind == "subject" and isinstance(f.content, Mapping)), None)
    if file is None or document.get("trials"):
        return dict(document)
    return {**file, **document, "subject": {**file["subject"], **document["subject"]}}


def _show(
    found: Sequence[Found],
    roles: Mapping[str, tuple[str, str]],
    settings: Settings,
    files: ArrayFiles,
    sheet: _Sheet,
) -> None:
    """Every recording in one set of axes, with its forces."""
    seen = [f.content for f in found if isinstance(f.content, Seen)]
    if not seen:
        sheet.problems.append(
            ProblemEntry(
                severity="error",
                field="trials",
                problem="there is no recording that can be read",
                remedy="Upload C3D or TRC files with markers",
            )
        )
        return
    static = static_of(roles)
    given = settings.up, settings.forward
    axes = session_axes(seen, static, *given)
    sheet.axes = axes_entry(axes, *given)
    forces = {f.name: f.content for f in found if isinstance(f.content, GroundForces)}
    for item in seen:
        try:
            entry, trial = recording_proof(item, axes, _ground(item, roles, forces), given, files)
        except InputError as error:
            sheet.problems.append(problem_of(error, file=item.file))
        else:
            sheet.recordings.append(entry)
            sheet.trials[item.file] = trial


def _ground(
    item: Seen, roles: Mapping[str, tuple[str, str]], forces: Mapping[str, GroundForces]
) -> Ground | None:
    """The forces of the file that is for this recording, else of its own plates."""
    for file, (role, _) in roles.items():
        if role == f"forces.{item.file}" and file in forces:
            return Ground(file, forces[file])
    return None if item.forces is None else Ground(item.file, item.forces)


def _missing(known: Mapping[str, Any], names: Sequence[str]) -> Iterator[ProblemEntry]:
    for place, file in named_in(known).items():
        if file not in names:
            yield ProblemEntry(
                severity="error",
                file=file,
                field=place,
                problem="the document names it, but it was not uploaded",
                remedy="Upload it, or remove it from the document",
            )


def _model(
    folder: Path, known: Mapping[str, Any], roles: Mapping[str, tuple[str, str]], sheet: _Sheet, usual: str
) -> BodyModel:
    """The model whose markers are looked for; the usual one where that cannot be had."""
    places = {role: file for file, (role, _) in roles.items()}
    wanted = str(known.get("model") or places.get("model") or usual)
    is_file = wanted.lower().endswith(MODEL_SUFFIXES)
    takes_more = wanted.lower().endswith(".osim")
    marker_set = known.get("marker_set") or places.get("marker_set") if takes_more else None
    try:
        return read_model(folder / wanted if is_file else wanted, folder / marker_set if marker_set else None)
    except InputError as error:
        sheet.problems.append(problem_of(error, file=wanted))
        return builtin(usual)


def _explicit(markers: Sequence[MarkerProof], known: Mapping[str, Any]) -> dict[str, str]:
    """What must stand under ``markers:`` because scaling would not find it by the names."""
    named = dict(known.get("markers") or {})
    sure = {m.marker: m.label for m in markers if m.label is not None and m.source == "laboratory"}
    return {marker: label for marker, label in sure.items() if label not in named.values()} | named


def _refusals(
    folder: Path, proposed: Mapping[str, Any] | None, settings: Settings, read: Mapping[Path, Recording]
) -> Iterator[ProblemEntry]:
    """The first thing that scaling would refuse, and what it would warn of."""
    if proposed is None:
        return
    try:
        subject = subject_from_document(check_document(proposed), folder=folder)
        session = load(subject, settings, read).session
        yield from map(warnings.warning_entry, session.warnings)
        if session.scale_setup is None and session.images is None:
            require_landmarks(session)
        calibrate(session, "MB", settings.calibration, {})  # in closed form: it takes milliseconds
    except InputError as error:
        yield problem_of(error)


def _role(item: Found, roles: Mapping[str, tuple[str, str]], known: Mapping[str, Any]) -> FileRole:
    role, why = roles.get(item.name, (None, item.why))
    named = item.name in named_in(known).values()
    if item.kind == "forces" and role is None and item.usable:
        why = f"{why}, but no movement without plates of its own has its name or time"
    if item.kind == "recording" and role is None and item.usable and not known.get("trials"):
        why = "somebody stands still in it, too, but one static trial is enough"
    return FileRole(
        name=item.name,
        kind=item.kind,
        role=role,
        named=named,
        why="the document names it" if named else why,
        problem=item.problem,
    )


def _silent(what: str, share: float) -> None:
    """No progress is shown."""
