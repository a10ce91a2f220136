"""Skin over bone as a random field on each segment: markers that are close move alike.

What all markers of a segment do together looks like a motion of the bone and leaves no residual. Its size can
only be guessed: from how far the skin deforms in this recording, and from what was measured over bone pins
and by fluoroscopy (``reference_models/skin_motion.yaml``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scaling_service.model.reference import read_reference, reference_folder
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.rigid import fit_rigid

if TYPE_CHECKING:
    from scaling_service.capabilities.motion.inverse_kinematics import Task

_PIN = "pin"
"""Part of a label, between underscores, that says a marker is fixed to the bone."""

_APART = 1e-9  # of the variance, each marker's own: two that a model puts in one place have a covariance, too
_FRAMES = 200  # looked at, equally spaced (chosen: skin moves slowly, neighbours tell the same)
_RESOLUTION_M = 1e-4  # chosen: below it deformation is the cameras' noise


@dataclass(frozen=True, slots=True, eq=False)
class SkinField:
    """The skin over one segment."""

    markers: NDArray[np.intp]  # (m,): numbers of its markers in the task
    # (m, m), m2: covariance of their displacements along any one axis
    covariance: Array


def skin_fields(task: Task) -> Iterator[SkinField]:
    """The field over every segment whose markers sit on skin.

    The standard deviation of a displacement along one axis is a mean, by logarithms, of the published one and
    of that which explains how far the segment's markers depart from a rigid cluster; a marker whose size the
    model holds, learnt from recordings, has that one.
    """
    owners = [task.model.marker(name).segment for name in task.markers]
    for segment in dict.fromkeys(owners):
        rows = np.array(
            [k for k, s in enumerate(owners) if s == segment and not is_pin(task.markers[k])],
            dtype=np.intp,
        )
        if len(rows):
            places = np.array([task.model.marker(task.markers[k]).nominal for k in rows])
            alike = np.exp(
                -np.linalg.norm(places[:, None] - places, axis=2) / _published()["length_mm"] * 1e3
            )
            sd = published_sd(segment)
            recorded = _recorded_sd(places, task.measured[:, rows], alike)
            if recorded is not None:
                share = _published()["recorded_share"]
                sd = float(sd ** (1.0 - share) * max(recorded, _RESOLUTION_M) ** share)
            own = [task.model.marker(task.markers[k]).skin_sd for k in rows]
            sds = np.array([sd if size is None else max(size, _RESOLUTION_M) for size in own])
            yield SkinField(rows, np.outer(sds, sds) * (alike + _APART * np.eye(len(rows))))


def is_pin(marker: str) -> bool:
    """Whether a label says that its marker is fixed to the bone.

    Examples
    --------
    >>> is_pin("tibia_LM_pin"), is_pin("SPINE")
    (True, False)
    """
    return _PIN in marker.lower().split("_")


def published_sd(segment: str) -> float:
    """Standard deviation of the skin's displacement along one axis, m, over a segment of this name.

    Examples
    --------
    >>> published_sd("femur_r")
    0.012
    """
    table = _published()
    name = segment.lower()
    found = next((row for row in table["segments"] if name.startswith(tuple(row["names"]))), table["other"])
    return float(found["largest_mm"]) / float(table["largest_over_sd"]) * 1e-3


@cache
def _published() -> Mapping[str, Any]:
    table: Mapping[str, Any] = read_reference(reference_folder() / "skin_motion.yaml")
    return table


def _recorded_sd(places: Array, measured: Array, alike: Array) -> float | None:
    """The standard deviation that explains the deformation of a cluster, m; None where nothing shows it.

    ``places`` (m, 3), ``measured`` (n, m, 3), ``alike`` (m, m): correlation of displacements.
    """
    count = len(places)
    whole = np.flatnonzero(np.isfinite(measured).all(axis=(1, 2)))
    some = measured[whole[np.linspace(0, len(whole) - 1, min(len(whole), _FRAMES)).astype(np.intp)]]
    rotation, shift = fit_rigid(places, some)
    known = np.isfinite(shift).all(axis=1)
    if count < 3 or not known.any():
        return None
    left = some[known] - np.einsum("nij,mj->nmi", rotation[known], places) - shift[known, None]
    rigid = rigid_modes(places)
    free = np.eye(3 * count) - rigid @ np.linalg.pinv(rigid)
    expected = float(np.trace(free @ np.kron(alike, np.eye(3))))
    return float(np.sqrt(np.square(left).sum(axis=(1, 2)).mean() / expected))


def rigid_modes(places: Array) -> Array:
    """How points (m, 3) move with the shifts and small turns of a rigid body, (3 m, 6)."""
    turns = np.cross(np.eye(3)[None], (places - places.mean(axis=0))[:, None]).transpose(0, 2, 1)
    return np.concatenate([np.tile(np.eye(3), (len(places), 1)), turns.reshape(-1, 3)], axis=1)
