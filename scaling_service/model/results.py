"""What the estimators hand on: motions and calibrations, frozen and named."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Literal

import numpy as np

from scaling_service.core.arrays import Array as Array
from scaling_service.model import body
from scaling_service.model.trial import ImagePose


@dataclasses.dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class Motion:
    """The coordinates of a model over one trial, with what they leave unexplained."""

    trial: str
    times: Array  # (n_frames,), s
    coordinates: tuple[str, ...]
    q: Array
    """(n_frames, n_coordinates), rad or m: NaN where the markers of that frame do not determine the
    coordinate."""
    markers: tuple[str, ...]  # the markers compared, in the order of residuals
    residuals: Array  # (n_frames, n_markers, 3), m: measured minus model; NaN where the marker was not seen
    estimated: tuple[str, ...]  # coordinates that the recording determines; the others stand at their default
    iterations: int = 0
    turns: Mapping[str, Array] = dataclasses.field(default_factory=dict)
    """Measured rotation to how far the model's is from it, (n_frames,), rad; NaN where not measured."""

    def __repr__(self) -> str:
        determined = f"{len(self.estimated)} of {len(self.coordinates)} coordinates determined"
        return f"Motion of '{self.trial}': {len(self.times)} frames, {determined}"

    @property
    def distances(self) -> Array:
        """Distance between measured and model marker, (n_frames, n_markers), m."""
        lengths: Array = np.linalg.norm(self.residuals, axis=2)
        return lengths

    def column(self, coordinate: str) -> Array:
        """One coordinate over the trial, (n_frames,), rad or m."""
        return self.q[:, self.coordinates.index(coordinate)]


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedParameter:
    """A fitted number with its uncertainty.

    ``sd`` is NaN where it cannot be known. ``identifiable`` is False where the recording says
    no more about it than its bounds do.
    """

    name: str
    value: float
    unit: Literal["m", "rad", "1"]
    sd: float
    at_bound: bool
    identifiable: bool
    group: str
    target: str


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class SegmentSize:
    """A segment's size over the generic model's, and what it rests on."""

    dimension: str  # the person's dimension that it follows, such as femur_r
    factor: float
    sd: float  # standard deviation, relative
    measured: float
    others: float
    """``measured``, ``others``: shares of the estimate that the segment's own distances and those of other
    segments decide; the rest is what persons of this stature, mass and sex are like."""
    own: bool = True  # whether a distance of the segment itself was measured

    @property
    def expected(self) -> float:
        """The share that anthropometry decides."""
        return 1.0 - self.measured - self.others


@dataclasses.dataclass(frozen=True, slots=True)
class EstimatedCentre:
    """How a joint centre of the person was found in a recording.

    ``sd`` is its standard deviation along x, y, z of the pelvis, m.
    """

    source: str
    sd: body.Vector


@dataclasses.dataclass(frozen=True, slots=True)
class JointMove:
    """How an image moved a joint of an OpenSim model, beyond what the scale factors do."""

    shift: body.Vector = (0.0, 0.0, 0.0)  # of its centre, m, in the parent segment's frame
    turn: body.Vector = (
        0.0,
        0.0,
        0.0,
    )  # of its rotation axes: a rotation vector, rad, in the joint's own frame
    child_turn: body.Vector = (0.0, 0.0, 0.0)
    """Of the child against the joint, in the child's frame: a rotation vector, rad."""
    child_shift: body.Vector = (0.0, 0.0, 0.0)
    """How far that moves the child's origin, m, in the frame that the child had before."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Calibration:
    """A scaled model and how it came about."""

    method: str  # MB, MB_lam, MB_am, EB, EB_am, MAP
    model: body.BodyModel  # with all parameters folded in; generic is what it was made from
    generic: body.BodyModel
    scale_factors: Mapping[str, body.Vector]  # segment to its x, y, z factors against the generic model
    axis_tilts: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    """Knee (joint name) to the turns of its axis about x and y of the thigh, rad."""
    parameters: tuple[EstimatedParameter, ...] = ()
    cost: float = float("nan")
    """m2: the cumulative kinematic error over the calibration frames (Puchaud 2019, eq. 1)."""
    iterations: int = 0
    wall_s: float = 0.0
    warnings: tuple[str, ...] = ()
    contradictions: tuple[str, ...] = ()  # of the warnings: what markers and images say against each other
    image_poses: Mapping[str, ImagePose] = dataclasses.field(default_factory=dict)
    """Segment to where its frame lies in the image, for those that were imaged."""
    sizes: Mapping[str, SegmentSize] = dataclasses.field(default_factory=dict)
    """Segment to its estimated size, where markers and anthropometry gave it."""
    centres: Mapping[str, EstimatedCentre] = dataclasses.field(default_factory=dict)
    """``hip_r`` … to how the person's joint centre was found."""
    bone_sized: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Segment to whose bone sizes it, for those that images size: ``own`` or ``other leg``."""
    joint_moves: Mapping[str, JointMove] = dataclasses.field(default_factory=dict)
    """Joint to how images moved it, for OpenSim models; ``axis_tilts`` come after these turns."""
