"""Landmarks on bones as a job."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import pydantic

from scaling_service.capabilities.landmarks.result import LandmarksDocument
from scaling_service.capabilities.shared import job
from scaling_service.capabilities.shared.names import BONE_NAMES
from scaling_service.core.errors import SubjectInvalid
from scaling_service.core.progress import Progress
from scaling_service.documents import base


class LandmarksRequest(job.OfOneSubject, job.WithTables):
    """Find joint centres, axes and bony landmarks on surfaces of bones."""

    bones: dict[str, str] | None = pydantic.Field(
        default=None,
        description=f"Of {', '.join(BONE_NAMES)} to an uploaded mesh's name, or segmentation to that of a "
        "label map; the subject's unless given.",
        examples=[{"femur_r": "femur_r.stl"}],
    )
    units: Literal["mm", "cm", "m", "detect"] = pydantic.Field(
        default="detect", description="Unit of all meshes."
    )

    @pydantic.field_validator("bones")
    @classmethod
    def _known(cls, bones: dict[str, str] | None) -> dict[str, str] | None:
        for bone in bones or ():
            if bone not in (*BONE_NAMES, "segmentation"):
                raise ValueError(
                    f"'{bone}' is not a bone that has landmarks; they are {', '.join(BONE_NAMES)}"
                )
        return bones

    def meshes(self, document: Mapping[str, Any]) -> dict[str, str]:
        """Bone to file, as asked for or as the subject's document says."""
        bones = dict(document.get("bones") or {})
        bones.pop("units", None)
        return self.bones if self.bones is not None else {k: v for k, v in bones.items() if v is not None}

    def list_needed(self, documents: job.Documents) -> job.Needed:
        """The meshes."""
        found = self.meshes(documents[self.subject])
        if not found:
            raise SubjectInvalid(
                "no bone is given",
                field="bones",
                remedy="Name uploaded meshes under `bones` in the request or in the subject's document",
            )
        return {
            self.subject: {
                f"bones.{bone}": base.require_plain_name(file, f"bones.{bone}")
                for bone, file in found.items()
            }
        }


def work(request: LandmarksRequest, inputs: Path, outputs: Path, progress: Progress) -> Any:
    """Write ``landmarks.json``, which is also the result."""
    from scaling_service.capabilities.landmarks.result import tabulate_points
    from scaling_service.capabilities.landmarks.run import landmark_bones, list_absent, save_landmarks
    from scaling_service.capabilities.shared.tables import make_table_writer

    write_tables = make_table_writer(request.tables, outputs)
    folder = inputs / request.subject
    document = json.loads((folder / base.DOCUMENT).read_text(encoding="utf-8"))
    bones = {bone: folder / file for bone, file in request.meshes(document).items()}
    found = landmark_bones(bones, units=request.units, progress=progress)
    write_tables({"landmarks": tabulate_points(found)}, found)
    save_landmarks(found, outputs)
    return found.model_dump(mode="json", exclude=list_absent(found))


def list_kinds() -> dict[str, job.Kind]:
    """What the service offers of this capability."""
    return {
        "landmarks": job.Kind(
            request=LandmarksRequest, work=work, route="scalings/mesh-landmarks", result=LandmarksDocument
        ),
    }
