"""``landmarks.json``: what was found on bones, mm, in the image's own axes."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from scaling_service.core.tables import ResultTable
from scaling_service.documents.base import Part

LANDMARKS_SCHEMA_VERSION = 1
"""Raised when a reader of an older document would misread a newer one; new keys do not raise it."""

Vector = tuple[float, float, float]
Side = Literal["r", "l"]


class ShapeFit(Part):
    """A sphere or cylinder on a bone."""

    shape: Literal["sphere", "cylinder"]
    centre_mm: Vector = Field(description="A cylinder's is the point of its axis beside the joint centre.")
    radius_mm: float
    axis: Vector | None = Field(default=None, description="Of a cylinder, to the subject's right.")
    rms_mm: float
    covered: float = Field(description="Share of the sphere, or of the cylinder's turn, that is covered.")


class BoneDocument(Part):
    """What all bones have."""

    side: Side | None = Field(description="Null for a pelvis.")
    side_from: Literal["shape", "name"] = Field(description="name: too incomplete to tell; it was believed.")
    fit_rms_mm: float | None = Field(description="The largest of the fits'; null without a fit.")
    fits: dict[str, ShapeFit]
    deviations_mm: dict[str, float] = Field(
        description="Landmark to the root mean square distance from where an expert would put it: from its "
        "fit, the mesh and its definition. 1.7 times it holds 95 %."
    )
    deviations_deg: dict[str, float] = Field(description="The same of each axis, as an angle.")
    definitions: dict[str, str] = Field(description="Landmark to how it is defined.")
    refused: dict[str, str] = Field(description="Landmark that could not be found, and why.")
    warnings: list[str]


class FemurDocument(BoneDocument):
    """A femur; what was refused is null."""

    hip_centre_mm: Vector | None = None
    head_radius_mm: float | None = None
    knee_centre_mm: Vector | None = None
    knee_axis: Vector | None = Field(default=None, description="Through the spheres, to the subject's right.")
    knee_axis_cylinder: Vector | None = None
    knee_axes_apart_deg: float | None = None
    epicondyle_medial_mm: Vector | None = None
    epicondyle_lateral_mm: Vector | None = None


class TibiaDocument(BoneDocument):
    """A tibia with or without its fibula."""

    ankle_centre_mm: Vector | None = None
    ankle_centre_from: Literal["talus", "malleoli"] | None = None
    knee_centre_mm: Vector | None = Field(
        default=None, description="Where no femur shows it: over the plateaus, as in other persons."
    )
    ankle_centre_malleoli_mm: Vector | None = Field(default=None, description="Where a talus was given too.")
    ankle_axis: Vector | None = Field(default=None, description="Of the talus, to the subject's right.")
    plateau_axis: Vector | None = Field(default=None, description="Across the plateau, to the right.")
    malleolus_medial_mm: Vector | None = None
    malleolus_lateral_mm: Vector | None = None
    malleolus_medial_prominence_mm: Vector | None = None
    malleolus_lateral_prominence_mm: Vector | None = None
    fibula_head_mm: Vector | None = None
    plateau_medial_mm: Vector | None = None
    plateau_lateral_mm: Vector | None = None


class TalusDocument(BoneDocument):
    """A talus."""

    ankle_centre_mm: Vector | None = None
    ankle_axis: Vector | None = None
    subtalar_centre_mm: Vector | None = Field(default=None, description="A point on the subtalar axis.")
    subtalar_axis: Vector | None = Field(
        default=None, description="Forward, from the heel facet to the head."
    )


class PelvisDocument(BoneDocument):
    """Both hip bones."""

    asis_r_mm: Vector | None = None
    asis_l_mm: Vector | None = None
    mid_asis_mm: Vector | None = None
    psis_r_mm: Vector | None = None
    psis_l_mm: Vector | None = None
    acetabulum_r_mm: Vector | None = None
    acetabulum_l_mm: Vector | None = None
    pubic_tubercle_r_mm: Vector | None = None
    pubic_tubercle_l_mm: Vector | None = None
    asis_axis: Vector | None = Field(default=None, description="From the left ASIS to the right one.")
    pose_odds_log10: float | None = Field(
        default=None,
        description="How much likelier among people it lies this way than in any other, in tens.",
    )


class LandmarksDocument(Part):
    """``landmarks.json``; only bones that were given are in it."""

    schema_version: int = LANDMARKS_SCHEMA_VERSION
    code_version: str
    settings: dict[str, Any]
    input_hashes: dict[str, str]
    seed: None = Field(default=None, description="Nothing in landmarking is random.")
    wall_s: float
    warnings: list[str] = Field(description="Of bones beside each other; each bone has its own, too.")
    pelvis: PelvisDocument | None = None
    femur_r: FemurDocument | None = None
    tibia_r: TibiaDocument | None = None
    talus_r: TalusDocument | None = None
    femur_l: FemurDocument | None = None
    tibia_l: TibiaDocument | None = None
    talus_l: TalusDocument | None = None

    @property
    def bones(self) -> dict[str, BoneDocument]:
        """Those that were given, by name."""
        every = {name: getattr(self, name) for name in type(self).model_fields}
        return {name: bone for name, bone in every.items() if isinstance(bone, BoneDocument)}


def tabulate_points(document: LandmarksDocument) -> ResultTable:
    """Every point of every bone in the image's axes with its deviation, mm."""
    rows = tuple(
        (name, point, *value, bone.deviations_mm[point])
        for name, bone in document.bones.items()
        for field, value in bone
        if field.endswith("_mm") and isinstance(value, tuple)
        for point in [field.removesuffix("_mm")]
    )
    return ResultTable("Landmarks", ("bone", "point", "x_mm", "y_mm", "z_mm", "sd_mm"), rows)
