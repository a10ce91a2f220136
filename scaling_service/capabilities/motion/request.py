"""The request to follow recordings with a model that exists, as `ik` on the command line takes it."""

from __future__ import annotations

from pathlib import PurePath

from pydantic import Field

from scaling_service.capabilities.motion.options import MotionOptions
from scaling_service.capabilities.scaling.request import Documents, Needed, OfOneSubject
from scaling_service.core.errors import SubjectInvalid
from scaling_service.documents.names import plain_name
from scaling_service.documents.reading import check_document
from scaling_service.documents.subject import MODEL_SUFFIXES, SubjectDocument


class MotionRequest(OfOneSubject, MotionOptions):
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

    def needed(self, documents: Documents) -> Needed:
        """The model, where it is a file, with its marker set, and the recordings."""
        document = check_document(documents[self.subject])
        named = {f"recordings.{k}": name for k, name in enumerate(self.select_recordings(document))}
        model = self.chosen_model(document)
        if model.lower().endswith(MODEL_SUFFIXES):
            named["model"] = model
        marker_set = self.marker_set(document)
        if marker_set is not None:
            named["marker_set"] = marker_set
        return {self.subject: {field: plain_name(name, field) for field, name in named.items()}}

    def chosen_model(self, document: SubjectDocument) -> str:
        """The model asked for, else the subject's."""
        return self.model if self.model is not None else document.model

    def marker_set(self, document: SubjectDocument) -> str | None:
        """The subject's markers to add, where the model is the subject's own."""
        return document.marker_set if self.chosen_model(document) == document.model else None

    def select_recordings(self, document: SubjectDocument) -> list[str]:
        """The recordings asked for, else the subject's movements, else what stands still.

        Raises
        ------
        SubjectInvalid
            Two recordings have the same name without suffix, by which results are named.
        """
        trials = document.trials
        chosen = self.recordings or [*trials.calibration, *trials.evaluation] or list(trials.files)
        names = list(dict.fromkeys(chosen))
        if len({PurePath(name).stem for name in names}) < len(names):
            raise SubjectInvalid(
                "two recordings have the same name without suffix",
                field="recordings",
                remedy="Results are named by it: leave one out, or upload it under another name",
            )
        return names

    @property
    def chosen(self) -> MotionOptions:
        """The same for the computation."""
        return MotionOptions(**{name: getattr(self, name) for name in MotionOptions.model_fields})
