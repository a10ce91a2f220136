"""The motion of recordings with a model that exists, as a job."""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import Any

from pydantic import Field

from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.motion.result import MotionDocument
from scaling_service.capabilities.shared import job
from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.progress import Progress
from scaling_service.documents import base, reading, subject


class MotionRequest(job.OfOneSubject, job.WithTables, MotionOptions):
    """Follow recordings with a model that exists: coordinates with their standard deviations.

    The model may be one that scaling, dynamics, consistent or discovery made: upload its `model.json` as a
    file of the subject, as any recording that the subject's document does not name.
    """

    model: str | None = Field(
        default=None,
        description="A built-in name, or an uploaded .osim or model.json; the subject's own unless given.",
        examples=["lower_limb_14dof"],
    )
    recordings: list[str] | None = Field(
        default=None,
        min_length=1,
        description="Uploaded files; all movements of the subject's document unless given.",
        examples=[["walk.trc"]],
    )

    standing: str | None = Field(
        default=None,
        description="Uploaded orientations of sensors while the person stands as the model does; the "
        "subject's static trial unless given, where that is such a file.",
    )

    def list_needed(self, documents: job.Documents) -> job.Needed:
        """The model, where it is a file, with its marker set, and the recordings."""
        document = reading.check_document(documents[self.subject])
        named = {f"recordings.{k}": name for k, name in enumerate(self.select_recordings(document))}
        model = self.choose_model(document)
        if model.lower().endswith(subject.MODEL_SUFFIXES):
            named["model"] = model
        marker_set, standing = self.marker_set(document), self.choose_standing(document)
        if marker_set is not None:
            named["marker_set"] = marker_set
        if standing is not None:
            named["standing"] = standing
        return {self.subject: {field: base.require_plain_name(name, field) for field, name in named.items()}}

    def choose_model(self, document: subject.SubjectDocument) -> str:
        """The model asked for, else the subject's."""
        return self.model if self.model is not None else document.model

    def marker_set(self, document: subject.SubjectDocument) -> str | None:
        """The subject's markers to add, where the model is the subject's own."""
        return document.marker_set if self.choose_model(document) == document.model else None

    def choose_standing(self, document: subject.SubjectDocument) -> str | None:
        """What tells how sensors are put on."""
        static = document.trials.static
        if self.standing is not None or static is None:
            return self.standing
        return static if static.lower().endswith(".sto") else None

    def select_recordings(self, document: subject.SubjectDocument) -> list[str]:
        """The recordings asked for, else the subject's movements, else what stands still.

        Raises SubjectInvalid: two recordings have the same name without suffix, by which results are named.
        """
        trials = document.trials
        chosen = self.recordings or [*trials.calibration, *trials.evaluation] or list(trials.files)
        names = list(dict.fromkeys(chosen))
        # One of markers and one of sensors are one movement.
        files = map(PurePath, names)
        if len({(file.stem, file.suffix.lower() == ".sto") for file in files}) < len(names):
            raise SubjectInvalid(
                "two recordings have the same name without suffix",
                field="recordings",
                remedy="Results are named by it: leave one out, or upload it under another name",
            )
        return names


def work(request: MotionRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write each trial's motion with its standard deviations; ``ik.json`` is the result."""
    from scaling_service.capabilities.motion.run import ik
    from scaling_service.capabilities.motion.saving import save_motions
    from scaling_service.capabilities.shared.tables import make_table_writer
    from scaling_service.capabilities.subject.files import read_model

    write_tables = make_table_writer(request.tables, outputs)
    folder = inputs / request.subject
    document = reading.read_document(folder / base.DOCUMENT)
    name, marker_set = request.choose_model(document), request.marker_set(document)
    model = folder / name if name.lower().endswith(subject.MODEL_SUFFIXES) else name
    added = None if marker_set is None else folder / marker_set
    standing = request.choose_standing(document)
    files = [folder / recording for recording in request.select_recordings(document)]
    # Of the subject's labels those that this model and these recordings have.
    known = read_model(model, added).marker_names
    from scaling_service.files.recording import read_recording
    from scaling_service.model.anatomy.markers import strip_prefix

    labels = {
        plain
        for file in files
        for label in read_recording(file).labels
        for plain in (label, strip_prefix(label))
    }
    usual = {
        marker: label for marker, label in document.markers.items() if marker in known and label in labels
    }
    options = request.part(MotionOptions).model_copy(update={"markers": usual | request.markers})
    tracked = ik(
        model,
        files,
        options,
        marker_set=added,
        standing=None if standing is None else folder / standing,
        subject=request.subject,
        subject_file=folder / base.DOCUMENT,
        progress=progress,
    )
    saved = save_motions(tracked, outputs)
    write_tables(tracked.tables, saved)
    return saved.model_dump(mode="json")


def list_kinds() -> dict[str, job.Kind]:
    """What the service offers of this capability."""
    return {"motion": job.Kind(request=MotionRequest, work=work, route="motions", result=MotionDocument)}
