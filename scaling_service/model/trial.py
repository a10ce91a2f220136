"""A recording of markers as one frozen value, with everything that was done to it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.errors import MarkerMissing, TrialUnusable
from scaling_service.model.sizes import NOT_MEASURED, MeasuredSizes

Array = NDArray[np.float64]

_UNLABELLED = re.compile(
    r"^(\*\d*|\?+|[cu]_\d+|uname\*?\d*|(unlabell?ed|unnamed|unidentified)[\s_]*\d*)$", re.IGNORECASE
)
"""What systems write where nobody gave a label: ``*110`` (Vicon), ``U_3``, ``Unlabeled 12``."""


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
    frames: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Marker trajectories on one clock.

    Parameters
    ----------
    name : str
        The file's stem.
    times : ndarray, shape (n_frames,), s
        Strictly increasing.
    labels : tuple of str, length n_markers
    markers : ndarray, shape (n_frames, n_markers, 3), m
        NaN where a marker was not seen. X forward, Y up, Z right once oriented.
    rate_hz : float
    repairs : tuple of Repair
    sizes : MeasuredSizes
        Of the person, as the file states them.
    """

    name: str
    times: Array
    labels: tuple[str, ...]
    markers: Array
    rate_hz: float
    repairs: tuple[Repair, ...] = field(default=())
    sizes: MeasuredSizes = NOT_MEASURED

    def __post_init__(self) -> None:
        frames = len(self.times)
        if self.markers.shape != (frames, len(self.labels), 3):
            raise ValueError(
                f"markers {self.markers.shape} do not fit {frames} frames and {len(self.labels)} labels"
            )
        if frames == 0:
            raise TrialUnusable(
                f"trial '{self.name}' has no frame", file=self.name, remedy="Record or export it again"
            )
        self.times.setflags(write=False)
        self.markers.setflags(write=False)

    @property
    def n_frames(self) -> int:
        """The number of frames."""
        return len(self.times)

    def index(self, label: str) -> int:
        """Column of a label; raises MarkerMissing."""
        if label not in self.labels:
            raise MarkerMissing(label, self.name, self.labels)
        return self.labels.index(label)

    def position(self, label: str) -> Array:
        """Trajectory of one label, shape (n_frames, 3), m."""
        trajectory: Array = self.markers[:, self.index(label)]
        return trajectory

    def with_markers(self, markers: Array, *repairs: Repair) -> Trial:
        """The same clock and labels with other positions, and what was done noted."""
        return replace(self, markers=markers, repairs=self.repairs + repairs)

    def relabelled(self, names: dict[str, str]) -> Trial:
        """The labels renamed: ``names`` maps old to new; those not named keep their own."""
        return replace(self, labels=tuple(names.get(label, label) for label in self.labels))

    def selected(self, labels: Sequence[str]) -> Trial:
        """Only these labels, in this order; a label that is absent becomes an all-NaN column."""
        columns = np.full((self.n_frames, len(labels), 3), np.nan)
        for k, label in enumerate(labels):
            if label in self.labels:
                columns[:, k] = self.position(label)
        return replace(self, labels=tuple(labels), markers=columns)

    def frames(self, rows: Sequence[int] | NDArray[np.intp] | slice) -> Trial:
        """Only these frames."""
        return replace(self, times=self.times[rows], markers=self.markers[rows])
