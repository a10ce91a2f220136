"""What is measured of a person, as frozen values: recordings of markers, sizes taken by hand, images."""

from __future__ import annotations

import re
from collections import abc
from dataclasses import KW_ONLY, dataclass, field, replace
from types import MappingProxyType
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from scaling_service.core import errors
from scaling_service.core.arrays import Array
from scaling_service.model.body import Vector
from scaling_service.numerics.least_squares.problem import find_shown

_AGREE = 0.005
"""Chosen: heights, masses and sizes of two files that differ by less are one measurement, rounded."""

_UNLABELLED = re.compile(
    r"^(\*\d*|\?+|[cu]_\d+|uname\*?\d*|(unlabell?ed|unnamed|unidentified)[\s_]*\d*)$", re.IGNORECASE
)
"""What systems write where nobody gave a label: ``*110`` (Vicon), ``U_3``, ``Unlabeled 12``."""


@dataclass(frozen=True, slots=True)
class MeasuredSizes:
    """What was measured on a person by hand."""

    height_m: float | None = None
    mass_kg: float | None = None
    lengths_m: abc.Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Keys of ``RANGES_M`` to m."""

    def __bool__(self) -> bool:
        return self.height_m is not None or self.mass_kg is not None or bool(self.lengths_m)

    def or_else(self, other: MeasuredSizes) -> MeasuredSizes:
        """These sizes, and the other's where these say nothing."""
        return MeasuredSizes(
            other.height_m if self.height_m is None else self.height_m,
            other.mass_kg if self.mass_kg is None else self.mass_kg,
            {**other.lengths_m, **self.lengths_m},
        )

    def conflicts(self, other: MeasuredSizes) -> tuple[str, ...]:
        """Names of what both state differently."""
        mine, theirs = self.as_mapping(), other.as_mapping()
        return tuple(
            name
            for name, value in mine.items()
            if name in theirs and abs(theirs[name] - value) > _AGREE * abs(value)
        )

    def as_mapping(self) -> dict[str, float]:
        """All of it by name, m and kg; what is not known is left out."""
        whole = {"height": self.height_m, "mass": self.mass_kg}
        return {name: v for name, v in whole.items() if v is not None} | dict(self.lengths_m)


def merge(sizes: abc.Iterable[MeasuredSizes]) -> MeasuredSizes:
    """The sizes of several files as one; of two that differ the first counts.

    Examples
    --------
    >>> merge([MeasuredSizes(1.7), MeasuredSizes(1.8, 60.0)])
    MeasuredSizes(height_m=1.7, mass_kg=60.0, lengths_m={})
    """
    result = MeasuredSizes()
    for item in sizes:
        result = result.or_else(item)
    return result


def is_unlabelled(label: str) -> bool:
    """Whether a label is what a system writes where nobody gave one.

    Examples
    --------
    >>> [is_unlabelled(label) for label in ("*110", "S01:U_3", "Unlabeled 4", "RUPA", "C7")]
    [True, True, True, False, False]
    """
    return bool(_UNLABELLED.match(label.rpartition(":")[2].strip()))


@dataclass(frozen=True, slots=True)
class Repair:
    """One thing that was changed or decided while reading or processing a recording.

    ``what`` is a short kind (``gap_spline``, ``gap_solidification``, ``unit``, ``up_axis``, …),
    ``where`` the marker, column or row, ``detail`` plain English for a person.
    """

    what: str
    where: str
    detail: str
    _: KW_ONLY
    frames: int = 0
    off: float = 0.0  # RMS of what was wrong in these frames, SI, where that can be told


@dataclass(frozen=True, slots=True)
class Relabelling:
    """Labels that are wrong from one time to another, s: as they stand, to the right ones.

    None leaves the marker out.
    """

    labels: abc.Mapping[str, str | None]
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class GaitEvent:
    """A foot meets the ground (``strike``) or leaves it (``off``), s on the recording's clock."""

    side: Literal["r", "l"]
    kind: Literal["strike", "off"]
    time_s: float


def repair_each(flags: NDArray[np.bool_], labels: abc.Sequence[str], what: str, detail: str) -> list[Repair]:
    """One repair for each label that was concerned in any frame: ``flags`` is (n_frames, n_labels)."""
    counts = flags.sum(axis=0).tolist()
    return [Repair(what, label, detail, frames=n) for label, n in zip(labels, counts, strict=True) if n]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rotations:
    """Measured rotations of segments, or of sensors on them, frame by frame of their trial."""

    labels: tuple[str, ...]
    matrices: Array  # (n_frames, n_rotations, 3, 3): map each frame to ground; NaN where not measured
    # of segments, by a markerless system whose frames have anatomical axes, or of sensors put on anyhow
    of: Literal["segments", "sensors"]
    origins: Array | None = None  # (n_frames, n_rotations, 3), m: of the frames, where the system knows them

    def frames(self, rows: abc.Sequence[int] | NDArray[np.intp] | slice) -> Rotations:
        """Only these frames."""
        origins = None if self.origins is None else self.origins[rows]
        return replace(self, matrices=self.matrices[rows], origins=origins)

    def turn(self, turn: Array) -> Rotations:
        """The same in a laboratory that is turned: ``turn`` (3, 3) maps vectors to the new axes."""
        origins = None if self.origins is None else self.origins @ turn.T
        return replace(self, matrices=turn @ self.matrices, origins=origins)


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class Trial:
    """Marker trajectories on one clock, and rotations where a system measures them."""

    name: str  # the file's stem
    times: Array  # (n_frames,), s: strictly increasing
    labels: tuple[str, ...]
    markers: Array
    """(n_frames, n_markers, 3), m: NaN where a marker was not seen. X forward, Y up, Z right once
    oriented."""
    rate_hz: float
    repairs: tuple[Repair, ...] = field(default=())
    sizes: MeasuredSizes = field(default_factory=MeasuredSizes)  # of the person, as the file states them
    rotations: Rotations | None = None
    events: tuple[GaitEvent, ...] = ()  # of gait, as the file or a person says; empty where neither does

    def __post_init__(self) -> None:
        frames = len(self.times)
        if self.markers.shape != (frames, len(self.labels), 3):
            raise ValueError(
                f"markers {self.markers.shape} do not fit {frames} frames and {len(self.labels)} labels"
            )
        if frames == 0:
            raise errors.TrialUnusable(
                f"trial '{self.name}' has no frame", file=self.name, remedy="Record or export it again"
            )
        self.times.setflags(write=False)
        self.markers.setflags(write=False)

    def __repr__(self) -> str:
        what, count = type(self).__name__, len(self.labels)
        held = f"{count} markers" if self.rotations is None else f"{len(self.rotations.labels)} rotations"
        held = f"{count} markers and {held}" if self.rotations is not None and count else held
        return f"{what} '{self.name}': {self.n_frames} frames at {self.rate_hz:g} Hz, {held}"

    @property
    def n_frames(self) -> int:
        """The number of frames."""
        return len(self.times)

    @property
    def shown_labels(self) -> tuple[str, ...]:
        """The labels that some frame shows, in order."""
        shown = find_shown(self.markers)
        return tuple(label for label, once in zip(self.labels, shown, strict=True) if once)

    def index(self, label: str) -> int:
        """Column of a label; raises MarkerMissing."""
        if label not in self.labels:
            raise errors.MarkerMissing(label, self.name, self.labels)
        return self.labels.index(label)

    def position(self, label: str) -> Array:
        """Trajectory of one label, shape (n_frames, 3), m."""
        return self.markers[:, self.index(label)]

    def with_markers(self, markers: Array, *repairs: Repair) -> Self:
        """The same clock and labels with other positions, and what was done noted."""
        return replace(self, markers=markers, repairs=self.repairs + repairs)

    def relabel(self, names: dict[str, str]) -> Self:
        """The labels renamed: ``names`` maps old to new; those not named keep their own."""
        return replace(self, labels=tuple(names.get(label, label) for label in self.labels))

    def select(self, labels: abc.Sequence[str]) -> Trial:
        """Only these labels, in this order; a label that is absent becomes an all-NaN column."""
        columns = np.full((self.n_frames, len(labels), 3), np.nan)
        own = {label: k for k, label in reversed(list(enumerate(self.labels)))}  # the first of a name
        for k, label in enumerate(labels):
            if label in own:
                columns[:, k] = self.markers[:, own[label]]
        return replace(self, labels=tuple(labels), markers=columns)

    def frames(self, rows: abc.Sequence[int] | NDArray[np.intp] | slice) -> Trial:
        """Only these frames."""
        turned = None if self.rotations is None else self.rotations.frames(rows)
        return replace(self, times=self.times[rows], markers=self.markers[rows], rotations=turned)


@dataclass(frozen=True, slots=True, eq=False)
class Bone:
    """A bone's surface in the image's frame."""

    vertices: Array  # (n_vertices, 3), m
    faces: NDArray[np.integer]  # (n_faces, 3): indices of each triangle's corners


@dataclass(frozen=True, slots=True, eq=False)
class ImagePose:
    """Where a segment's frame lies in the image: ``point_image = rotation @ point_segment + origin``."""

    rotation: Array  # (3, 3)
    origin: Array  # (3,), m

    def carry(self, frame: tuple[Array, Array]) -> ImagePose:
        """The pose of what lies at a rotation, (3, 3), and an origin, (3,) m, in this segment's frame."""
        rotation, origin = frame
        return ImagePose(self.rotation @ rotation, self.origin + self.rotation @ origin)

    def to_local(self, points: Array) -> Array:
        """Points of the image, (n, 3) or (3,), in the segment's frame, m."""
        return (points - self.origin) @ self.rotation


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageEvidence:
    """Points of one image session, all in its frame, m."""

    centres: abc.Mapping[str, Vector] = field(default_factory=dict)
    """``hip_r``, ``knee_r``, ``ankle_r``, ``subtalar_r`` and the left ones, as far as imaged."""
    axes: abc.Mapping[str, Vector] = field(default_factory=dict)
    """``knee_r``, ``ankle_r``, ``subtalar_r`` and the left ones: directions of axes, either way round."""
    landmarks: abc.Mapping[str, Vector] = field(default_factory=dict)
    """Points on bone by the name of the marker that is put on them (``RASIS``, ``RLFE`` …)."""
    markers: abc.Mapping[str, tuple[str, Vector]] = field(default_factory=dict)
    """Skin markers seen in the image: model marker to (segment, position)."""
    source: str = ""  # how they were found
    deviations: abc.Mapping[str, float] = field(default_factory=dict)
    """Of centres and landmarks, by their names: root mean square distance from an expert's, m."""
    axis_deviations: abc.Mapping[str, float] = field(default_factory=dict)  # rad
    bones: abc.Mapping[str, Bone] = field(default_factory=dict)
    """Segment to the surface of its bone, as far as imaged."""
