"""Pelvis, thighs and shanks: 14 degrees of freedom, the 14 markers of Puchaud et al. 2019, table 1."""

from __future__ import annotations

import numpy as np

from tests.blind.bodies.person import Person
from tests.blind.body import GROUND, Body, Marker, Segment, Vector, slide, turn

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

THIGH_M, SHANK_M = 0.43245, 0.4152
"""Puchaud et al. 2019, table 2: mean EOS lengths."""

HIP: Vector = (-0.0471, -0.0831, 0.08675)
"""Harrington et al. 2007 for an ASIS width of 240.8 and a pelvic depth of 155 mm, from mid-ASIS."""

ROOT = (
    slide(X, "pelvis_tx"),
    slide(Y, "pelvis_ty"),
    slide(Z, "pelvis_tz"),
    turn(Y, "pelvis_rotation"),
    turn(X, "pelvis_list"),
    turn(Z, "pelvis_tilt"),
)
"""Turn, obliquity, tilt: Baker 2001."""

# Share of the body's mass; centre of mass and radii of gyration over the length: Dumas et al. 2007, male,
# without the small products of inertia.
_DUMAS = {
    "thigh": (0.123, (-0.041, -0.429, 0.033), (0.29, 0.15, 0.30)),
    "shank": (0.048, (-0.048, -0.410, 0.007), (0.28, 0.10, 0.28)),
}
_PELVIS = (0.142, (-0.078, -0.034, 0.0), (0.095, 0.099, 0.089))
"""Dumas 2007, male pelvis, length 0.0936 m: here in m from mid-ASIS."""

_MARKERS: tuple[tuple[str, str, str, Vector], ...] = (
    ("ASIS", "pelvis", "pelvis", (0.0, 0.0, 0.1204)),
    ("PSIS", "pelvis", "pelvis", (-0.155, 0.0, 0.0422)),
    ("LFE", "femur", "thigh", (0.0, -THIGH_M, 0.0533)),
    ("MFE", "femur", "thigh", (0.0, -THIGH_M, -0.0533)),
    ("FH", "tibia", "shank", (-0.020, -0.051, 0.048)),
    ("LM", "tibia", "shank", (-0.011, -0.4202, 0.041)),
    ("MM", "tibia", "shank", (0.011, -0.4102, -0.041)),
)
"""Suffix, segment, part that scales it, place on the right side (Rajagopal 2016, CusToM; skin markers)."""


def lower_limb(person: Person, name: str = "lower_limb") -> Body:
    """Legs without feet; their inertia is set but no force is recorded."""
    segments = [pelvis(person)]
    for side in ("r", "l"):
        segments += leg(person, side)
    return Body(name, tuple(segments), leg_markers(person))


def pelvis(person: Person) -> Segment:
    """The root."""
    share, com, radii = _PELVIS
    return solid(
        "pelvis", GROUND, "ground_pelvis", (0, 0, 0), ROOT, share * person.mass_kg,
        person.scaled("pelvis", com), person.scaled("pelvis", radii),
    )  # fmt: skip


def leg(person: Person, side: str) -> list[Segment]:
    """Thigh and shank of a side; the left one's x and y turns are reversed."""
    s = 1.0 if side == "r" else -1.0
    hip = (
        turn(Z, f"hip_flexion_{side}"),
        turn((s, 0, 0), f"hip_adduction_{side}"),
        turn((0, s, 0), f"hip_rotation_{side}"),
    )
    knee = (turn((0, 0, -1), f"knee_angle_{side}"),)
    thigh = person.scaled("thigh", (0, -THIGH_M, 0))
    return [
        _limb(person, "thigh", THIGH_M, f"femur_{side}", "pelvis", f"hip_{side}",
              person.scaled("pelvis", sided(HIP, s)), hip, s),
        _limb(person, "shank", SHANK_M, f"tibia_{side}", f"femur_{side}", f"knee_{side}", thigh, knee, s),
    ]  # fmt: skip


def _limb(person, part, length, name, parent, joint, centre, moves, s) -> Segment:  # type: ignore[no-untyped-def]
    share, com, radii = _DUMAS[part]
    return solid(
        name, parent, joint, centre, moves, share * person.mass_kg,
        person.scaled(part, times3(sided(com, s), length)), person.scaled(part, times3(radii, length)),
    )  # fmt: skip


def leg_markers(person: Person) -> tuple[Marker, ...]:
    """The 14 anatomical markers."""
    return tuple(
        Marker(
            f"{'R' if s > 0 else 'L'}{suffix}",
            segment if segment == "pelvis" else f"{segment}_{'r' if s > 0 else 'l'}",
            person.scaled(part, sided(at, s)),
        )
        for s in (1.0, -1.0)
        for suffix, segment, part, at in _MARKERS
    )


def sided(at: Vector, s: float) -> Vector:
    """The mirror image for s = -1."""
    return (at[0], at[1], s * at[2])


def times3(at: Vector, factor: float) -> Vector:
    """A vector times a number."""
    return (at[0] * factor, at[1] * factor, at[2] * factor)


def solid(name, parent, joint, centre, moves, mass, com, radii) -> Segment:  # type: ignore[no-untyped-def]
    """A segment from its radii of gyration about the centre of mass, m."""
    xx, yy, zz = (float(mass * r**2) for r in np.asarray(radii))
    inertia = ((xx, 0.0, 0.0), (0.0, yy, 0.0), (0.0, 0.0, zz))
    return Segment(name, parent, joint, tuple(map(float, centre)), moves, mass, com, inertia)
