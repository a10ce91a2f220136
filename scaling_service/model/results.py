"""What the estimators hand on: motions and calibrations, frozen and named."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scaling_service.model.body import BodyModel, Vector
from scaling_service.model.images import ImagePose

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The coordinates of a model over one trial, with what they leave unexplained.

    Parameters
    ----------
    trial : str
    times : (n_frames,), s
    coordinates : tuple of str
    q : (n_frames, n_coordinates), rad or m
        NaN where the markers of that frame do not determine the coordinate.
    markers : tuple of str
        The markers compared, in the order of ``residuals``.
    residuals : (n_frames, n_markers, 3), m
        Measured minus model; NaN where the marker was not seen.
    estimated : tuple of str
        Coordinates that the recording determines; the others stand at their default.
    iterations : int
    """

    trial: str
    times: Array
    coordinates: tuple[str, ...]
    q: Array
    markers: tuple[str, ...]
    residuals: Array
    estimated: tuple[str, ...]
    iterations: int = 0

    @property
    def distances(self) -> Array:
        """Distance between measured and model marker, (n_frames, n_markers), m."""
        lengths: Array = np.linalg.norm(self.residuals, axis=2)
        return lengths

    def column(self, coordinate: str) -> Array:
        """One coordinate over the trial, (n_frames,), rad or m."""
        column: Array = self.q[:, self.coordinates.index(coordinate)]
        return column


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class SegmentSize:
    """A segment's size over the generic model's, and what it rests on.

    Parameters
    ----------
    dimension : str
        The person's dimension that it follows, such as ``femur_r``.
    factor : float
    sd : float
        Standard deviation, relative.
    measured, others : float
        Shares of the estimate that the segment's own distances and those of other segments decide; the rest
        is what persons of this stature, mass and sex are like.
    own : bool
        Whether a distance of the segment itself was measured.
    """

    dimension: str
    factor: float
    sd: float
    measured: float
    others: float
    own: bool = True

    @property
    def expected(self) -> float:
        """The share that anthropometry decides."""
        return 1.0 - self.measured - self.others


@dataclass(frozen=True, slots=True)
class EstimatedCentre:
    """How a joint centre of the person was found in a recording.

    ``sd`` is its standard deviation along x, y, z of the pelvis, m.
    """

    source: str
    sd: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A scaled model and how it came about.

    Parameters
    ----------
    method : str
        ``MB``, ``MB_lam``, ``MB_am``, ``EB`` or ``EB_am``.
    model : BodyModel
        With all parameters folded in; ``generic`` is what it was made from.
    scale_factors : mapping
        Segment to its x, y, z factors against the generic model.
    axis_tilts : mapping
        Knee (joint name) to the turns of its axis about x and y of the thigh, rad.
    parameters : tuple of EstimatedParameter
    cost : float, m2
        The cumulative kinematic error over the calibration frames (Puchaud 2019, eq. 1).
    iterations : int
    wall_s : float
    warnings : tuple of str
    image_poses : mapping
        Segment to where its frame lies in the image, for those that were imaged.
    sizes : mapping
        Segment to its estimated size, where markers and anthropometry gave it.
    centres : mapping
        ``hip_r`` … to how the person's joint centre was found.
    """

    method: str
    model: BodyModel
    generic: BodyModel
    scale_factors: Mapping[str, Vector]
    axis_tilts: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    parameters: tuple[EstimatedParameter, ...] = ()
    cost: float = float("nan")
    iterations: int = 0
    wall_s: float = 0.0
    warnings: tuple[str, ...] = ()
    image_poses: Mapping[str, ImagePose] = field(default_factory=dict)
    sizes: Mapping[str, SegmentSize] = field(default_factory=dict)
    centres: Mapping[str, EstimatedCentre] = field(default_factory=dict)
