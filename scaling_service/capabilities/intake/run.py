"""A look at a subject's files before anything is computed: what they are, and what to correct."""

from __future__ import annotations

import os
import re
from collections import abc
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pydantic
import yaml

from scaling_service.capabilities.intake import files as intake_files
from scaling_service.capabilities.intake import markers as intake_markers
from scaling_service.capabilities.intake import result as documents
from scaling_service.capabilities.intake import roles, tables, warnings
from scaling_service.capabilities.intake.readiness import judge_readiness, sum_up
from scaling_service.capabilities.intake.standing import sort_by_segment
from scaling_service.capabilities.scaling.methods.table import calibrate
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject import reading
from scaling_service.capabilities.subject.checks import require_landmarks
from scaling_service.capabilities.subject.files import read_files, read_model
from scaling_service.capabilities.subject.loading import load
from scaling_service.core import errors
from scaling_service.core.progress import Progress, show_nothing
from scaling_service.core.text import list_few
from scaling_service.documents import subject as subjects
from scaling_service.documents import writing
from scaling_service.documents.reading import check_document
from scaling_service.files.osim.setups import read_scale_setup
from scaling_service.files.table_files import ArrayFiles
from scaling_service.model.anatomy.key_points import add_key_points
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import load_builtin
from scaling_service.model.forces import GroundForces
from scaling_service.model.trial import MeasuredSizes, Trial
from scaling_service.recording import findings as recording_findings
from scaling_service.recording import person
from scaling_service.recording.identity.identify import Identification
from scaling_service.recording.orientation import check_axes

FILE_NAME, SUBJECT = "proof.json", "subject.yaml"
FOLDER = "proof"  # of the tables, below the job's files

_READ, _SHOWN = 0.5, 0.7  # chosen: about the shares of time


def prove_folder(
    folder: str | Path, out: str | Path, settings: Settings = Settings(), *, progress: Progress | None = None
) -> documents.ProofDocument:
    """Look at all files of a folder, and write what was found into another one.

    ``proof.json`` is the document, ``proof/`` holds the tables that it names, and ``subject.yaml`` is the
    subject file that is proposed, where there is a recording.

    Parameters
    ----------
    folder : path
        Holds recordings and what belongs to them; folders inside are not looked at.
    out : path
        Made if it does not exist. Other files in it stay.
    settings : Settings
        The laboratory's axes, where they are known.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    ProofDocument
        What the files are, what is wrong with each remedy, and which analyses can run. mm, kg.

    Raises
    ------
    FileUnreadable
        There is no such folder.
    InputError
        The axes are none, or ``out`` cannot be written to.

    Examples
    --------
    >>> import scaling_service as ss
    >>> proof = ss.prove_folder("plates", "looked")
    >>> [analysis.analysis for analysis in proof.readiness if analysis.ready]
    ['comparisons', 'discoveries', 'dynamics', 'consistent-motions']
    """
    source, target = Path(folder), Path(out)
    if not source.is_dir():
        raise errors.FileUnreadable(
            "there is no such folder", file=source, remedy="Name the folder of the recordings"
        )
    name = source.absolute().name
    identity = name if re.fullmatch(r"\w[\w .\-]{0,99}", name) else "subject"
    with writing.all_or_nothing(target) as scratch:
        found = prove(source, {"subject": {"id": identity}}, scratch, settings=settings, progress=progress)
        writing.write_json(scratch / FILE_NAME, found)
        if found.proposal is not None:
            beside = Path(os.path.relpath(source.absolute(), target.absolute()))
            content = intake_files.map_files(found.proposal, lambda _, name: (beside / name).as_posix())
            (scratch / SUBJECT).write_text(
                yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8"
            )
    return found


def prove(
    folder: Path,
    document: abc.Mapping[str, Any],
    outputs: Path,
    *,
    skip: abc.Sequence[str] = (),
    labels: abc.Mapping[str, str] | None = None,
    settings: Settings = Settings(),
    progress: Progress | None = None,
) -> documents.ProofDocument:
    """Look at all files of a folder, tell what they are for, and what scaling would refuse.

    ``document``: the subject's document, or as much of it as there is: at least ``subject`` with its ``id``.
    ``outputs``: where tables are written, in the folder ``proof``.
    ``skip``: files that are not looked at.
    ``labels``: label to model marker, as the laboratory has them.
    Raises InputError: only where the axes in the settings are none; what is wrong with files is in the
        result.
    """
    check_axes(settings.up, settings.forward)
    report = progress or show_nothing
    names = sorted(p.name for p in folder.iterdir() if p.is_file() and p.name not in skip)
    found: list[intake_files.InputFile] = []
    for k, name in enumerate(names):
        report(f"reading {name}", _READ * k / len(names))
        found.append(intake_files.look_into(folder / name, settings.up, settings.forward))
    look = _Look(folder, document, found, settings)
    known, trials = look.known, look.trials
    sizes = roles.check_sizes(known, look.list_stated_sizes())
    report("showing the recordings", _READ)
    look.show_recordings(ArrayFiles(outputs, FOLDER))
    report("naming the markers", _SHOWN)
    mapped, stature = known.get("markers") or {}, sizes.height_m
    who = intake_markers.identify_labels(trials, look.static, stature, mapped, labels or {})
    usual, why = look.usual_model(who)
    model = add_key_points(look.read_model(usual), [x for one in trials.values() for x in one.labels])
    markers, unused = intake_markers.propose_markers(model, trials, mapped, labels or {}, who)
    extra = intake_markers.assign_extra_markers(unused, who, model)
    # What must stand under `markers:` because scaling would not find it by the names
    named = dict(known.get("markers") or {})
    sure = {
        m.marker: m.label
        for m in markers
        if m.label is not None
        and (m.source == "laboratory" or (m.source == "place" and m.confidence > intake_markers.SURE))
    }
    explicit = (
        {marker: label for marker, label in sure.items() if label not in named.values()} | named
    ) | intake_markers.find_sacral_label(markers, who)
    free = [one for one in extra if one.label not in explicit.values()]
    proposed = roles.propose_subject(known, found, look.roles, usual, explicit)
    if proposed is not None:
        whole = intake_markers.with_extra_markers(proposed, model, markers, free, trials)
        whole = roles.with_sizes(whole, sizes)
        proposed = {key: whole[key] for key in subjects.SubjectDocument.model_fields if key in whole}
    report("asking what scaling would refuse", _SHOWN)
    look.problems += [*look.compare(sizes), *roles.ask_for_person(sizes)]
    look.problems += look.refusals(proposed, who)
    files = [look.role(item) for item in found]
    look.problems += warnings.check_unused_forces(files, look.recordings)
    readiness = judge_readiness(proposed, look.recordings, markers, model, sizes, look.problems)
    every = list(dict.fromkeys(label for trial in trials.values() for label in trial.labels))
    chosen = str(known.get("model") or (proposed or {}).get("model") or usual)
    return documents.ProofDocument(
        subject=str(known["subject"]["id"]),
        model=chosen,
        model_why=why if chosen == usual and not known.get("model") else None,
        axes=look.axes,
        files=files,
        recordings=look.recordings,
        marker_set=intake_markers.check_marker_set(every),
        consequences=list(intake_markers.describe_consequences(every, sizes)),
        sizes=sizes,
        markers=markers,
        unused_labels=unused,
        extra_markers=extra,
        readiness=readiness,
        headline=sum_up(look.problems, readiness),
        proposal=proposed,
        problems=look.problems,
    )


class _Look:
    """What is known of a folder: its files and their roles, and what is found on the way."""

    def __init__(
        self,
        folder: Path,
        document: abc.Mapping[str, Any],
        found: abc.Sequence[intake_files.InputFile],
        settings: Settings,
    ) -> None:
        self.folder, self.found, self.settings = folder, found, settings
        self.known = intake_files.merge_known(found, document)
        self.roles = roles.assign_roles(found, self.known)
        self.static = roles.choose_static(self.roles)
        self.raw = [f.content for f in found if isinstance(f.content, intake_files.RecordingFile)]
        self.problems: list[documents.ProblemEntry] = []
        self.seen = [self._correct_labels(item) for item in self.raw]
        self.forces = {f.name: f.content for f in found if isinstance(f.content, GroundForces)}
        self.recordings: list[documents.RecordingProof] = []
        self.trials: dict[str, Trial] = {}
        self.ground: dict[str, GroundForces] = {}  # by the recordings' files, at their times
        self.axes: documents.AxesEntry | None = None
        self.problems += [*self._missing(), *self._folders()]

    def _correct_labels(self, item: intake_files.RecordingFile) -> intake_files.RecordingFile:
        """A recording with the labels put right that the document says are wrong."""
        try:
            wanted = pydantic.TypeAdapter(subjects.Corrections).validate_python(
                (self.known.get("corrections") or {}).get(item.file) or []
            )
            mirrored = (self.known.get("mirrored") or {}).get(item.file)
            events = (self.known.get("events") or {}).get(item.file)
            if events is not None:
                told = reading.list_events(pydantic.TypeAdapter(subjects.GaitEvents).validate_python(events))
                item = replace(item, trial=replace(item.trial, events=told))
            if not wanted and mirrored not in ("x", "y", "z"):
                return item
            whole = item.trial.take_unlabelled({label for one in wanted for label in one.labels})
            trial = person.mend(whole, reading.list_relabellings(wanted), mirrored)
            axes = intake_files.decide_axes(trial, self.settings.up, self.settings.forward)
            return replace(item, trial=trial, axes=axes)
        except errors.InputError as error:
            self.problems.append(intake_files.make_problem(error, file=item.file))
        except pydantic.ValidationError:
            pass  # reported with all else that is wrong with the document
        return item

    def _missing(self) -> abc.Iterator[documents.ProblemEntry]:
        names = [item.name for item in self.found]
        for place, file in roles.list_named_files(self.known).items():
            if file not in names:
                yield documents.ProblemEntry(
                    severity="error",
                    file=file,
                    field=place,
                    problem="the document names it, but it was not uploaded",
                    remedy="Upload it, or remove it from the document",
                )

    def _folders(self) -> abc.Iterator[documents.ProblemEntry]:
        """Folders inside, which are not looked at; those that this look has written are no matter."""
        inside = sorted(p for p in self.folder.iterdir() if p.is_dir() and not p.name.startswith("."))
        unread = [place.name for place in inside if any(p.is_file() for p in place.iterdir())]
        unread = [name for name in unread if not (self.folder / name / FILE_NAME).is_file()]
        if unread:
            yield documents.ProblemEntry(
                severity="warning",
                problem=f"folders inside it are not looked at: {list_few(unread)}",
                remedy="Put their files beside the others if they belong to this person",
            )

    def list_stated_sizes(self) -> dict[str, MeasuredSizes]:
        """File to what it states of the person: recordings, then the scale set-up."""
        sizes = {item.file: item.trial.sizes for item in self.seen}
        for file, (role, _) in self.roles.items():
            if role == "scale_setup":
                with suppress(errors.InputError):  # scaling's own refusal says it
                    setup = read_scale_setup(self.folder / file)
                    sizes[file] = MeasuredSizes(setup.height_m, setup.mass_kg)
        return sizes

    def show_recordings(self, files: ArrayFiles) -> None:
        """Every recording in one set of axes, with its forces."""
        if not self.seen:
            self.problems.append(
                documents.ProblemEntry(
                    severity="error",
                    field="trials",
                    problem="there is no recording that can be read",
                    remedy="Upload C3D or TRC files with markers",
                )
            )
            return
        given = self.settings.up, self.settings.forward
        axes = intake_files.decide_session_axes(self.seen, self.static, *given)
        self.axes = intake_files.make_axes_entry(axes, *given)
        for item in self.seen:
            try:
                entry, trial, forces = tables.check_recording(
                    item,
                    axes,
                    self._ground(item),
                    given,
                    files,
                    events_given=item.file in (self.known.get("events") or {}),
                )
            except errors.InputError as error:
                self.problems.append(intake_files.make_problem(error, file=item.file))
            else:
                self.recordings.append(entry)
                self.trials[item.file] = trial
                if forces is not None:
                    self.ground[item.file] = forces

    def _ground(self, item: intake_files.RecordingFile) -> tables.Ground | None:
        """The forces of the file that is for this recording, else of its own plates."""
        for file, (role, _) in self.roles.items():
            if role == f"forces.{item.file}" and file in self.forces:
                return tables.Ground(file, self.forces[file])
        return None if item.forces is None else tables.Ground(item.file, item.forces)

    def usual_model(self, who: Identification) -> tuple[str, str]:
        """The built-in model for these recordings, and why."""
        moving = [t for file, t in self.trials.items() if file != self.static and file in self.roles]
        shown = [trial.shown_labels for trial in moving or self.trials.values()]
        return intake_markers.choose_model(shown, any(recording.plates for recording in self.recordings), who)

    def read_model(self, usual: str) -> BodyModel:
        """The model whose markers are looked for; the usual one where that cannot be had."""
        places = {role: file for file, (role, _) in self.roles.items()}
        wanted = str(self.known.get("model") or places.get("model") or usual)
        is_file, is_osim = (wanted.lower().endswith(suffix) for suffix in (subjects.MODEL_SUFFIXES, ".osim"))
        more = self.known.get("marker_set") or places.get("marker_set") if is_osim else None
        try:
            return read_model(
                self.folder / wanted if is_file else wanted, self.folder / more if more else None
            )
        except errors.InputError as error:
            self.problems.append(intake_files.make_problem(error, file=wanted))
            return load_builtin(usual)

    def compare(self, sizes: documents.SizesProof) -> abc.Iterator[documents.ProblemEntry]:
        """What the recordings, compared with each other and with their forces, give cause to correct."""
        spans = {name: (float(f.times[0]), float(f.times[-1])) for name, f in self.forces.items()}
        yield from warnings.check_standing(self.roles, self.trials, wanted=not self.known.get("trials"))
        yield from warnings.check_units(self.seen)
        yield from warnings.check_labels(self.seen)
        yield from warnings.check_times(self.recordings, spans)
        yield from warnings.check_plates(self.recordings)
        yield from warnings.check_weight(self.ground, self.trials, sizes)
        yield from warnings.check_faults(self.recordings)

    def refusals(
        self, proposed: abc.Mapping[str, Any] | None, who: Identification
    ) -> abc.Iterator[documents.ProblemEntry]:
        """The first thing that scaling would refuse, and what it would warn of."""
        if proposed is None:
            return
        read = {(self.folder / item.file).absolute(): item.trial for item in self.raw}
        try:
            subject = reading.make_subject(check_document(proposed), folder=self.folder)
            files = read_files(subject, read)
            session = load(subject, files, self.settings, facing=True, who=who).session
            found = [one for one in session.notes if isinstance(one, recording_findings.Finding)]
            yield from self._tell(found)
            yield from warnings.tell_notes(one for one in session.notes if one not in found)
            if session.scale_setup is None and session.images is None:
                require_landmarks(session)
            calibrate(session, "MB", self.settings.calibration, {})  # in closed form: it takes milliseconds
        except recording_findings.NotAPerson as error:
            yield from self._tell(error.findings)
        except errors.InputError as error:
            yield intake_files.make_problem(error)

    def _tell(
        self, findings: abc.Sequence[recording_findings.Finding]
    ) -> abc.Iterator[documents.ProblemEntry]:
        """What scaling found, and labels of any segment that stand for each other, known by words alone."""
        trials = list(self.trials.values())
        clusters = sort_by_segment(list(dict.fromkeys(label for trial in trials for label in trial.labels)))
        yield from warnings.tell_findings(
            recording_findings.sort_findings([*person.ask_segments(trials, clusters), *findings]), self.trials
        )

    def role(self, item: intake_files.InputFile) -> documents.FileRole:
        """A file and its place in the document."""
        role, why = self.roles.get(item.name, (None, item.why))
        named = item.name in roles.list_named_files(self.known).values()
        if item.kind == "forces" and role is None and item.usable:
            why = f"{why}, but no movement without plates of its own has its name or time"
        if item.kind == "recording" and role is None and item.usable and not self.known.get("trials"):
            why = "somebody stands still in it, too, but one static trial is enough"
        why = "the document names it" if named else why
        return documents.FileRole(
            name=item.name, kind=item.kind, role=role, named=named, why=why, problem=item.problem
        )
