"""Legs with feet and one trunk with head and arms: 21 degrees of freedom, 30 markers."""

from __future__ import annotations

from tests.blind.bodies.lower_limb import SHANK_M, X, Y, Z, leg, leg_markers, pelvis, sided, solid
from tests.blind.bodies.person import Person
from tests.blind.body import Body, Marker, Segment, Vector, turn

ANKLE_HEIGHT_M = 0.0687
"""Of the ankle's centre above the sole: .039 of the stature (Winter 2009)."""

BALL_X_M = 0.125
"""From the ankle's centre to the ball of the foot (chosen: 70 % of Dumas' 0.182 m to the toe tip)."""

_FOOT = (0.012, (0.070, -0.028, 0.0), (0.031, 0.067, 0.066))
"""Dumas 2007, male foot, length 0.1822 m: centre of mass and radii of gyration in m."""

_TRUNK = (0.492, (0.0, 0.298, 0.0), (0.206, 0.127, 0.190))
"""Dumas 2007: torso, head and hanging arms as one, from the lumbar joint; by the parallel-axis rule."""

_LUMBAR: Vector = (-0.0807, -0.0077, 0.0)
"""From mid-ASIS: Reed 1999 as given by Dumas and Wojtusch 2018, male."""

_SIDED: tuple[tuple[str, str, str, Vector], ...] = (
    ("THI", "femur", "thigh", (0.030, -0.220, 0.075)),
    ("SHN", "tibia", "shank", (0.030, -0.200, 0.040)),
    ("HEE", "calcn", "foot", (-0.066, -0.042, 0.0)),
    ("TOE", "calcn", "foot", (0.130, -0.040, 0.0)),
    ("MT5", "calcn", "foot", (0.090, -0.050, 0.050)),
    ("SHO", "torso", "trunk", (0.000, 0.450, 0.180)),
)
_MIDDLE: tuple[tuple[str, str, str, Vector], ...] = (
    ("C7", "torso", "trunk", (-0.075, 0.470, 0.0)),
    ("CLAV", "torso", "trunk", (0.075, 0.400, 0.0)),
    ("STRN", "torso", "trunk", (0.110, 0.270, 0.0)),
    ("T10", "torso", "trunk", (-0.095, 0.220, 0.0)),
)
"""Chosen: palpation sites set by eye for this stature."""


def whole_body(person: Person, name: str = "whole_body") -> Body:
    """A body that stands on its feet."""
    segments = [pelvis(person), _torso(person)]
    for side in ("r", "l"):
        segments += [*leg(person, side), _foot(person, side)]
    extra = [
        Marker(f"{letter}{suffix}", segment if segment == "torso" else f"{segment}_{letter.lower()}",
               person.scaled(part, sided(at, s)))
        for letter, s in (("R", 1.0), ("L", -1.0))
        for suffix, segment, part, at in _SIDED
    ]  # fmt: skip
    middle = [Marker(name, segment, person.scaled(part, at)) for name, segment, part, at in _MIDDLE]
    return Body(name, tuple(segments), (*leg_markers(person), *extra, *middle))


def _torso(person: Person) -> Segment:
    share, com, radii = _TRUNK
    moves = (turn(Z, "lumbar_extension"), turn(X, "lumbar_bending"), turn(Y, "lumbar_rotation"))
    return solid(
        "torso", "pelvis", "lumbar", person.scaled("pelvis", _LUMBAR), moves, share * person.mass_kg,
        person.scaled("trunk", com), person.scaled("trunk", radii),
    )  # fmt: skip


def _foot(person: Person, side: str) -> Segment:
    s = 1.0 if side == "r" else -1.0
    share, com, radii = _FOOT
    moves = (turn(Z, f"ankle_angle_{side}"), turn((s, 0, 0), f"ankle_inversion_{side}"))
    return solid(
        f"calcn_{side}", f"tibia_{side}", f"ankle_{side}", person.scaled("shank", (0, -SHANK_M, 0)), moves,
        share * person.mass_kg, person.scaled("foot", sided(com, s)), person.scaled("foot", radii),
    )  # fmt: skip
