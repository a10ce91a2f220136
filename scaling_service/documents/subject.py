"""The subject document: what a user writes in YAML or JSON, before any path is followed."""

from __future__ import annotations

import re
from collections import abc
from pathlib import PurePath
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator
from pydantic_core import PydanticCustomError

from scaling_service.core.text import suggest_name

SIZE_UNIT = "_mm"  # how the name of a size ends in a subject file

SIDED: abc.Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "leg_length": (0.25, 1.4),
        "knee_width": (0.04, 0.20),
        "ankle_width": (0.03, 0.12),
        "asis_trochanter": (0.01, 0.12),
        "elbow_width": (0.03, 0.15),
        "wrist_width": (0.02, 0.10),
        "hand_thickness": (0.008, 0.06),
        "shoulder_offset": (0.01, 0.09),
    }
)
"""Sizes of either side, such as ``knee_width_r``, and the range of living persons, m. Chosen: from a small
child to the largest adult, and each less than a factor of ten wide, so that a unit shows itself.
Definitions as in the conventional gait model (Davis 1991; Vicon's Plug-in Gait): ``leg_length`` from the ASIS
over the knee to the medial malleolus, widths across epicondyles and malleoli without markers,
``asis_trochanter`` in the sagittal plane, ``shoulder_offset`` from the acromion's marker to the centre."""

WHOLE: abc.Mapping[str, tuple[float, float]] = MappingProxyType(
    {"asis_width": (0.09, 0.40), "marker_diameter": (0.0035, 0.03)}
)
"""Sizes without a side: between the ASIS, and of the marker's ball."""

RANGES_M: abc.Mapping[str, tuple[float, float]] = MappingProxyType(
    {f"{name}_{side}": limits for name, limits in SIDED.items() for side in "rl"} | dict(WHOLE)
)
"""Every size that is known, with its range, m."""


HEIGHT_RANGE_M = (0.3, 2.8)
"""Chosen: from a preterm infant to the tallest person on record (2.72 m); centimetres fall outside."""

MASS_RANGE_KG = (1.0, 400.0)
"""Chosen: from an infant to beyond what a force plate is built for; grams fall outside."""

MODEL_SUFFIXES = (".osim", ".json")
"""Of models that are files: OpenSim's, and this program's own (model.json)."""

Name = Annotated[str, StringConstraints(min_length=1, max_length=200)]

BoneName = Literal[
    "pelvis", "femur_r", "tibia_r", "talus_r", "calcn_r", "femur_l", "tibia_l", "talus_l", "calcn_l"
]
Identifier = Annotated[str, StringConstraints(pattern=r"^[\p{L}\p{N}_][\p{L}\p{N}_ .\-]*$", max_length=100)]

_OTHER_BONES = re.compile(r"calc|heel|patella|fibula|sacrum|foot|toe", re.IGNORECASE)


class _Strict(BaseModel):
    """No unknown keys, no conversions: a number in quotes is an error."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def _make_error(problem: str, remedy: str, field: str = "") -> PydanticCustomError:
    """An error that carries its remedy, and the field when it is deeper than the model it is raised in."""
    return PydanticCustomError("subject", "{problem}", {"problem": problem, "remedy": remedy, "field": field})


class Person(_Strict):
    """Who was recorded."""

    id: Identifier = Field(description="Names the person; also names folders.")
    sex: Literal["F", "M"] | None = Field(default=None, description="Needed by inertial tables.")
    height_m: float | None = Field(default=None, description="Stature, m.")
    mass_kg: float | None = Field(default=None, description="Body mass, kg.")

    @model_validator(mode="after")
    def _plausible(self) -> Person:
        for field, unit, (low, high), hint in (
            ("height_m", "m", HEIGHT_RANGE_M, "Give it in metres, such as 1.70"),
            ("mass_kg", "kg", MASS_RANGE_KG, "Give it in kilograms, such as 62.0"),
        ):
            value = getattr(self, field)
            if value is not None and not low <= value <= high:
                raise _make_error(f"{value:g} {unit} is not between {low:g} and {high:g} {unit}", hint, field)
        return self


class Trials(_Strict):
    """The recordings, by what they may be used for."""

    static: Name | None = Field(default=None, description="Standing still; needed by marker-based scaling.")
    calibration: list[Name] = Field(default=[], description="Frames for the optimisation come from here.")
    evaluation: list[Name] = Field(default=[], description="Never used to fit.")

    @model_validator(mode="after")
    def _separate(self) -> Trials:
        fitted = [*([self.static] if self.static else []), *self.calibration]
        if not fitted and not self.evaluation:
            raise _make_error("no recording is given", "Name at least a static or a calibration trial")
        for path in self.evaluation:
            if path in fitted:
                raise _make_error(
                    f"'{path}' is also used to fit; evaluation trials never are",
                    "Remove it from one of the two, or record another trial",
                    "evaluation",
                )
        # The static trial may serve for calibration as well; it then is one recording, not two.
        others = [self.static] if self.static and self.static not in self.calibration else []
        seen: dict[tuple[str, bool], tuple[str, str]] = {}
        for field, paths in (
            ("static", others),
            ("calibration", self.calibration),
            ("evaluation", self.evaluation),
        ):
            for path in paths:
                name = PurePath(path)
                of_sensors = name.suffix.lower() == ".sto"
                like = seen.get((name.stem, of_sensors))
                beside = seen.get((name.stem, not of_sensors))
                # Markers and sensors of one movement are one recording.
                other = like or (beside if beside is not None and beside[0] != field else None)
                if other is not None:
                    raise _make_error(
                        f"'{path}' and '{other[1]}' have the same name without suffix",
                        "Results are named by it: remove or rename one of them",
                        field,
                    )
                seen[name.stem, of_sensors] = (field, path)
        return self

    @property
    def files(self) -> tuple[str, ...]:
        """All recordings, each once."""
        static = (self.static,) if self.static else ()
        return tuple(dict.fromkeys((*static, *self.calibration, *self.evaluation)))


class Bones(_Strict):
    """Surface meshes of the person's bones, in one common image frame, or a segmentation of the image."""

    units: Literal["mm", "m"] = Field(
        default="mm", description="Unit of the coordinates in the files; a label map is in mm."
    )
    segmentation: Name | None = Field(
        default=None, description="A label map (.nii, .nii.gz), or a folder of one mask or surface a label."
    )
    pelvis: Name | None = None
    femur_r: Name | None = None
    tibia_r: Name | None = None
    femur_l: Name | None = None
    tibia_l: Name | None = None
    talus_r: Name | None = None
    talus_l: Name | None = None

    @model_validator(mode="before")
    @classmethod
    def _check_bones(cls, value: object) -> object:
        if isinstance(value, abc.Mapping) and "units" not in value and set(value) != {"segmentation"}:
            raise _make_error("the unit of the surfaces is missing", "Add `units:`, mm or m", "units")
        for name in value if isinstance(value, abc.Mapping) else ():
            if isinstance(name, str) and _OTHER_BONES.search(name):
                raise _make_error(
                    "nothing is measured on this bone",
                    "Leave it out: femur and tibia give the knee, the talus the ankle and the subtalar axis",
                    name,
                )
        return value

    @property
    def meshes(self) -> dict[str, str]:
        """Segment to file, of those given."""
        return {name: path for name, path in self.model_dump(exclude={"units"}).items() if path is not None}


class Correction(_Strict):
    """Labels of a recording that are wrong for a while, and what they should be."""

    labels: dict[Name, Name | None] = Field(
        min_length=1,
        description="A label as it stands in the file, to the right one; null leaves its marker out: a gap, "
        "filled as gaps are.",
    )
    from_s: float = Field(description="First time at which they are wrong, by the recording's clock.")
    to_s: float = Field(description="Last time at which they are wrong.")

    @model_validator(mode="after")
    def _each_once(self) -> Correction:
        right = [label for label in self.labels.values() if label is not None]
        if len(right) > len(set(right)):
            raise _make_error(
                "two labels cannot be one marker",
                "Give each right label once, and null to what is to be left out",
                "labels",
            )
        if any(label == name for label, name in self.labels.items()):
            raise _make_error("a label stands for itself", "Name only labels that are wrong", "labels")
        if self.to_s < self.from_s:
            raise _make_error("it ends before it begins", "Give the earlier time first", "to_s")
        return self


class GaitEventEntry(_Strict):
    """A foot meets the ground or leaves it."""

    side: Literal["r", "l"]
    kind: Literal["strike", "off"] = Field(description="It meets the ground, or leaves it.")
    time_s: float = Field(description="By the recording's clock.")


Corrections = Annotated[list[Correction], Field(max_length=200)]
"""Of one recording. Chosen: each copies the recording, and nobody makes so many by hand."""

GaitEvents = Annotated[list[GaitEventEntry], Field(max_length=20_000)]
"""Of one recording. Chosen: an hour of walking has 15,000."""


class SubjectDocument(_Strict):
    """The whole subject document.

    Paths are as written, relative to the document; nothing is read or looked for.
    """

    subject: Person
    model: Name = Field(description="A built-in model's name, or the path of an .osim file or a model.json.")
    marker_set: Name | None = Field(default=None, description="OpenSim markers to add; .osim models only.")
    scale_setup: Name | None = Field(default=None, description="OpenSim scale set-up; .osim models only.")
    markers: dict[Name, Name] = Field(default={}, description="Model marker to label in the recordings.")
    extra_markers: dict[Name, Name] = Field(default={}, description="Further labels, and their segments.")
    trials: Trials
    forces: dict[Name, Name] = Field(default={}, description="A trial's file name to its file of forces.")
    corrections: dict[Name, Corrections] = Field(
        default={}, description="A trial's file name to labels that are wrong in it for a while."
    )
    mirrored: dict[Name, Literal["x", "y", "z"]] = Field(
        default={}, description="A trial's file name to the axis along which its markers are mirrored."
    )
    events: dict[Name, GaitEvents] = Field(
        default={},
        description="A trial's file name to its heel strikes and toe-offs, in place of the file's own.",
    )
    bones: Bones | None = None
    bone_bodies: dict[BoneName, Name] = Field(
        default={},
        description="A bone (as under `bones`) to the model's segment that it belongs to; only where neither "
        "names nor joints tell.",
    )
    image_markers: Name | None = Field(default=None, description="CSV: marker,segment,x_mm,y_mm,z_mm.")
    sizes: dict[Name, float] = Field(default={}, description="Measured by hand, such as knee_width_r_mm.")

    @property
    def model_is_file(self) -> bool:
        """Whether ``model`` is a path rather than a built-in name."""
        return self.model.lower().endswith(MODEL_SUFFIXES)

    @model_validator(mode="after")
    def _consistent(self) -> SubjectDocument:
        for field in ("marker_set", "scale_setup"):
            if getattr(self, field) is not None and not self.model.lower().endswith(".osim"):
                raise _make_error(
                    f"it belongs to .osim models only, and the model is '{self.model}'",
                    "Remove it, or give the path of an .osim file under `model:`",
                    field,
                )
        meaning: dict[str, str] = {}
        for marker, label in self.markers.items():
            if label in meaning:
                raise _make_error(
                    f"label '{label}' already stands for '{meaning[label]}'",
                    "Map each label to one model marker",
                    f"markers.{marker}",
                )
            meaning[label] = marker
        for label in self.extra_markers:
            if label in meaning or label in self.markers:
                raise _make_error(
                    f"'{label}' is under `markers` too",
                    "Keep it there if it is one of the model's markers, else here",
                    f"extra_markers.{label}",
                )
        names = [PurePath(path).name for path in self.trials.files]
        named: dict[str, abc.Iterable[str]] = {
            "forces": self.forces,
            "corrections": self.corrections,
            "mirrored": self.mirrored,
            "events": self.events,
        }
        for field, trial in ((field, trial) for field, trials in named.items() for trial in trials):
            if trial not in names:
                raise _make_error(
                    "no trial has this file name",
                    f"Use the file name of a trial: {', '.join(names)}",
                    f"{field}.{trial}",
                )
        for name, value in self.sizes.items():
            limits = RANGES_M.get(name.removesuffix(SIZE_UNIT)) if name.endswith(SIZE_UNIT) else None
            if limits is None:
                known = [f"{size}{SIZE_UNIT}" for size in RANGES_M]
                raise _make_error(
                    "there is no such size",
                    f"{suggest_name(name, known)}Sizes are {', '.join(known)}",
                    f"sizes.{name}",
                )
            low, high = (1e3 * limit for limit in limits)
            if not low <= value <= high:
                raise _make_error(
                    f"{value:g} mm is not between {low:g} and {high:g} mm", "Give it in mm", f"sizes.{name}"
                )
        return self

    @property
    def sizes_m(self) -> dict[str, float]:
        """The sizes in m, by name without unit."""
        return {name.removesuffix(SIZE_UNIT): value * 1e-3 for name, value in self.sizes.items()}
