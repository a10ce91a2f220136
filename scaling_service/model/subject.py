"""What is known of a person, and where it lies on disk."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from scaling_service.core.notes import Note
from scaling_service.model import trial
from scaling_service.model.body import BodyModel

_NOTHING: Mapping[str, str] = MappingProxyType({})
_NO_SIZES: Mapping[str, float] = MappingProxyType({})


@dataclasses.dataclass(frozen=True, slots=True)
class Subject:
    """A subject file after validation: names and absolute paths, nothing read yet.

    Attributes
    ----------
    id : str
        Names the person in results.
    model : str
        A built-in name, or the absolute path of an ``.osim`` file or a ``model.json``.
    sex : str, optional
        ``F`` or ``M``.
    height_m, mass_kg : float, optional
        m and kg.
    marker_set, scale_setup : Path, optional
        OpenSim's, for ``.osim`` models.
    marker_map : mapping of str to str
        Model marker to label in the recordings.
    extra_markers : mapping of str to str
        Further labels to use, and the segment each sits on.
    static : Path, optional
        The standing trial.
    calibration, evaluation : tuple of Path
        Movements to fit, and movements that are never fitted.
    forces : mapping of str to Path
        A trial's file name to the file with its ground forces.
    corrections : mapping of str to tuple of Relabelling
        A trial's file name to labels that are wrong in it.
    mirrored : mapping of str to str
        A trial's file name to the axis, ``x``, ``y`` or ``z``, along which its markers are mirrored.
    events : mapping of str to tuple of GaitEvent
        A trial's file name to its events of gait, in place of the file's own.
    bones : mapping of str to Path
        Segment to mesh file, in ``bone_units``.
    bone_units : str
        ``mm`` or ``m``.
    bone_bodies : mapping of str to str
        Bone to the model's segment, where names and joints do not tell.
    image_markers : Path, optional
        Markers in the image's frame.
    sizes_m : mapping of str to float
        Measured by hand, m; keys of ``RANGES_M``.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.Subject("S01", "lower_limb_14dof", sex="F", height_m=1.70).height_m
    1.7
    """

    id: str
    model: str
    _: dataclasses.KW_ONLY
    sex: Literal["F", "M"] | None = None
    height_m: float | None = None
    mass_kg: float | None = None
    marker_set: Path | None = None
    scale_setup: Path | None = None
    marker_map: Mapping[str, str] = dataclasses.field(default_factory=lambda: _NOTHING)
    extra_markers: Mapping[str, str] = dataclasses.field(default_factory=lambda: _NOTHING)
    static: Path | None = None
    calibration: tuple[Path, ...] = ()
    evaluation: tuple[Path, ...] = ()
    forces: Mapping[str, Path] = dataclasses.field(default_factory=dict)
    corrections: Mapping[str, tuple[trial.Relabelling, ...]] = dataclasses.field(default_factory=dict)
    mirrored: Mapping[str, str] = dataclasses.field(default_factory=dict)
    events: Mapping[str, tuple[trial.GaitEvent, ...]] = dataclasses.field(default_factory=dict)
    bones: Mapping[str, Path] = dataclasses.field(default_factory=dict)
    bone_units: Literal["mm", "m"] = "mm"
    bone_bodies: Mapping[str, str] = dataclasses.field(default_factory=lambda: _NOTHING)
    image_markers: Path | None = None
    sizes_m: Mapping[str, float] = dataclasses.field(default_factory=lambda: _NO_SIZES)


def list_recordings(subject: Subject) -> tuple[Path, ...]:
    """The files of all trials, each once: static, calibration, evaluation."""
    static = () if subject.static is None else (subject.static,)
    return tuple(dict.fromkeys((*static, *subject.calibration, *subject.evaluation)))


@dataclasses.dataclass(frozen=True, slots=True)
class Measurement:
    """One measurement of a linear scaling: marker pairs whose mean length ratio scales segments.

    ``axes`` maps each scaled segment to the axes it applies to, such as ``"XYZ"`` or ``"Y"``.
    """

    name: str
    pairs: tuple[tuple[str, str], ...]
    axes: Mapping[str, str]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MarkerPlacement:
    """OpenSim's marker placer: fit the static pose, then move the markers of tracking kind.

    ``marker_weights`` and ``coordinate_weights`` are the tasks of the static fit (a coordinate's
    value is taken from ``coordinate_values`` or its default); ``fixed`` markers are not moved.
    """

    marker_weights: Mapping[str, float]
    coordinate_weights: Mapping[str, float]
    coordinate_values: Mapping[str, float]
    time_range: tuple[float, float] | None = None
    fixed: frozenset[str] = frozenset()


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ScaleSetup:
    """An OpenSim scale set-up, read.

    ``height_m`` and ``mass_kg`` are the person's where it states them.
    ``manual`` holds factors given outright (segment to x, y, z factors). ``order`` holds
    ``'measurements'`` and ``'manualScale'`` in the order in which they apply.
    """

    measurements: tuple[Measurement, ...]
    manual: Mapping[str, tuple[float, float, float]]
    order: tuple[str, ...]
    time_range: tuple[float, float] | None
    preserve_mass_distribution: bool
    mass_kg: float | None
    placement: MarkerPlacement | None
    height_m: float | None = None


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Session:
    """Everything of one subject in memory: the generic model and the processed recordings.

    Labels of the trials are the model's marker names (aliases and the subject's map applied);
    extra markers are among them. Positions are in m, X forward, Y up, Z right, NaN where missing.
    """

    subject: Subject
    model: BodyModel
    static: trial.Trial | None
    calibration: tuple[trial.Trial, ...]
    evaluation: tuple[trial.Trial, ...]
    scale_setup: ScaleSetup | None = None
    notes: tuple[Note, ...] = ()
    images: trial.ImageEvidence | None = None
    # Recordings of rotations without markers, which no method is fitted to, and what tells their mounting
    rotations: tuple[trial.Trial, ...] = ()
    standing_rotations: trial.Trial | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notes as sentences."""
        return tuple(map(str, self.notes))

    @property
    def unmarked(self) -> bool:
        """Whether no recording has a marker on skin: rotations alone, or key points of video."""
        marked = [one for one in (self.static, *self.dynamic) if one is not None]
        shown = [label for one in marked for label in one.shown_labels]
        return self.model.shows_key_points_alone(shown) if marked else bool(self.rotations)

    @property
    def dynamic(self) -> tuple[trial.Trial, ...]:
        """Calibration and evaluation trials, each once."""
        names = {t.name for t in self.calibration}
        return self.calibration + tuple(t for t in self.evaluation if t.name not in names)
