"""Skin that moves over the bone: marker displacements linear in the joint angles.

The model of Camomilla et al. 2013 and Bonci et al. 2014: a marker's displacement in its segment's
frame is ``sum_j h_j (q_j - q_j standing)``, one vector ``h_j`` per marker and joint angle. As every
displacement is a law of coordinates, the person with moving skin is again a body model.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.streams import stream
from scaling_service.model import body
from scaling_service.virtual.motion import draw_wandering

_PER_DEG = 1e-3 * 180.0 / np.pi  # mm per degree in m per radian

THIGH_MM_PER_DEG: Mapping[str, body.Vector] = {
    "hip_flexion": (0.3, 0.4, 0.3),
    "hip_adduction": (0.3, 0.4, 0.3),
    "hip_rotation": (0.3, 0.4, 0.3),
    "knee_angle": (0.2, 0.2, 0.2),
}
"""Standard deviation of the coefficients of thigh markers, x, y, z. Published coefficients were not
found; proposed (facts section 8) so that peaks over the movements are of the order of 30 mm (Leardini et
al. 2005, Camomilla et al. 2017), most of it along the thigh (Barre et al. 2017)."""

SHANK_MM_PER_DEG: Mapping[str, body.Vector] = {"knee_angle": (0.12, 0.12, 0.12)}
"""As the thigh's; peaks of the order of 20 mm."""

PELVIS_MM_PER_DEG: Mapping[str, body.Vector] = {"hip_flexion": (0.08, 0.08, 0.08)}
"""As the thigh's, by the hip of the marker's side; peaks of the order of 9 mm."""

SHARED = 0.75
"""Share of the coefficients' variance that all markers of a segment have in common: they move together by
about 18 mm and against each other by 4 to 16 mm (fluoroscopy of six knees, PMC8631460), so about
18^2 / (18^2 + 10^2)."""

RESIDUAL_MM = (2.0, 3.0)
"""RMS of what no joint angle explains, proposed (facts section 8)."""

RESIDUAL_HZ = 2.0
"""Highest frequency of that part (chosen): it lies near the movement's own (Leardini et al. 2005)."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Hidden:
    """One thing that was hidden in recordings."""

    kind: str  # as the catalogue of effects calls it
    where: tuple[str, ...]
    parameters: dict[str, float]  # with the unit in the name, as results have them
    driver: tuple[str, ...] = ()
    trial: str | None = None  # the only recording in which it is


@dataclasses.dataclass(frozen=True, slots=True)
class Artefact:
    """How the skin of one person moves."""

    coefficients: Mapping[str, Mapping[str, body.Vector]]
    """Marker to driving coordinate to displacement per angle, m/rad, in the segment's frame."""
    reference: Mapping[str, float]  # coordinate to its value standing, where nothing is displaced, rad
    residual_m: float  # RMS length of the part that no angle explains


def draw_artefact(seed: int, model: body.BodyModel, reference: Mapping[str, float], size: float) -> Artefact:
    """The skin of one person.

    ``reference``: the coordinates in the standing posture, rad. ``size``: multiplies every coefficient; one
    for the literature's, zero for none.
    """
    coefficients = {}
    for m in model.markers:
        if m.weight > 0.0:
            side = m.name[0].lower() if m.segment == "pelvis" else m.segment[-1]
            table = {"p": PELVIS_MM_PER_DEG, "f": THIGH_MM_PER_DEG, "t": SHANK_MM_PER_DEG}[m.segment[0]]
            found = {}
            for driver, spread in table.items():
                coordinate = f"{driver}_{side}"
                drawn = draw_shared(seed, "artefact", m.segment, coordinate, marker=m.name)
                found[coordinate] = body.to_vector(size * _PER_DEG * np.array(spread) * drawn)
            coefficients[m.name] = found
    low, high = RESIDUAL_MM
    residual = 1e-3 * size * stream(seed, "artefact", "residual").uniform(low, high)
    return Artefact(coefficients, dict(reference), float(residual))


def draw_shared(seed: int, *names: str | int, marker: str, count: int = 3) -> Array:
    """Normal numbers, (count,), of which a segment's markers have the share ``SHARED`` of variance in common.

    ``names``: of the random stream that all markers share.
    """
    together = stream(seed, *names).normal(size=count)
    alone = stream(seed, *names, marker).normal(size=count)
    return np.asarray(np.sqrt(SHARED) * together + np.sqrt(1.0 - SHARED) * alone)


def with_artefact(model: body.BodyModel, artefact: Artefact) -> body.BodyModel:
    """The model with markers that glide with the joint angles (the residual apart)."""
    moving = artefact.coefficients
    markers = [glide_marker(m, moving.get(m.name, {}), artefact.reference) for m in model.markers]
    return model.with_markers(tuple(markers))


def glide_marker(
    marker: body.Marker,
    per_rad: Mapping[str, body.Vector],
    reference: Mapping[str, float] = MappingProxyType({}),
) -> body.Marker:
    """A marker that moves over its segment with joint angles.

    ``per_rad``: coordinate to displacement, m/rad. ``reference``: coordinate to where there is none, rad.
    """
    laws = list(marker.laws)
    for coordinate, displacement in per_rad.items():
        standing = reference.get(coordinate, 0.0)
        for axis, gain in enumerate(body.to_vector(displacement)):
            if gain != 0.0:
                laws[axis] += body.Law.of(coordinate, gain, -gain * standing)
    x, y, z = laws
    return dataclasses.replace(marker, laws=(x, y, z))


def shift_marker(marker: body.Marker, by: Iterable[float]) -> body.Marker:
    """A marker that sits elsewhere on its segment, by (3,), m."""
    x, y, z = (law + body.Law.constant(float(shift)) for law, shift in zip(marker.laws, by, strict=True))
    return dataclasses.replace(marker, laws=(x, y, z))


def draw_residual(artefact: Artefact, rng: np.random.Generator, times: Array) -> Array:
    """What no angle explains, for one marker, (n_frames, 3), m, alike in all directions."""
    per_axis = artefact.residual_m / np.sqrt(3.0)
    return np.column_stack([draw_wandering(rng, times, per_axis, RESIDUAL_HZ) for _ in range(3)])
