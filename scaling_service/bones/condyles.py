"""The condyles of a femur: a sphere on each, a cylinder on both, and the frame in which they are found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scaling_service.bones import fits, shapes
from scaling_service.bones.deviations import GRAIN_M
from scaling_service.bones.surface import Surface
from scaling_service.core.arrays import Array

DISTAL_M = 0.05  # height of the block that holds the condyles: chosen, a little above their posterior rims

ARC_DEG = (-90.0, 50.0)
"""Part of the condyles that is fitted, about the knee axis from straight posterior, proximal positive:
from the most distal point (extension) to the end of the articular surface, over which the sagittal
section is circular (Eckhoff et al. 2005, Iwaki et al. 2000)."""

SPHERE_RIDGE, CYLINDER_RIDGE = float(np.sin(np.deg2rad(30.0))), float(np.sin(np.deg2rad(20.0)))
"""How far normals may lean out of the sagittal plane; chosen, so that the walls of the notch and the
epicondyles stay out while a sphere still sees its centre along the axis."""

CONDYLE_BAND = 0.08
"""Share of the radius beyond which a point of a condyle has no weight: chosen, 1.6 mm. It does not
follow the scatter, since a condyle is no exact sphere and a narrow band picks a part of it."""

ALIKE_M = 1e-3
"""Standard deviation of the difference of both condyles' radii: medial 21-22 mm, lateral 20-21 mm."""

CONDYLE_RADII_M = (0.012, 0.032)
"""Posterior condyles have radii of 20-22 mm in adults; chosen 40 % around them."""

MOST_APART_DEG = 12.0
"""Sphere axis against cylinder axis, above which both are refused: chosen, twice that of rough MRI."""

_APART = float(np.cos(np.deg2rad(MOST_APART_DEG)))
_SHORT_M, _END_M = 0.15, 0.03  # chosen: a piece shorter than this shows the shaft at its end only
_NOTCH = 0.08  # share of the width on either side of the middle that is left out; chosen
_LEAST_NOISE_M = 5e-5  # chosen: no segmentation is truer
_FIRST_NOISE_M = 5e-4  # chosen: between CT (0.1-0.3 mm) and rough MRI (0.6 mm)
_FACING = (0.7, 0.9)  # cosines between normal and radius, from no weight to full; chosen
_LEAN = 0.1  # half the width of the ramp around SPHERE_RIDGE; chosen
_BLUR_DEG = 8.0  # half the width of the ramps at both ends of the arc; chosen
_FEWEST = 12  # vertices on a condyle; chosen, three times what a sphere needs
_STEPS = 80
_WIDE, _CLOSING = 2.0, 0.8  # limits start three times as wide, since the first frame is 10 degrees off
_CLOSED = 30  # steps after which they have closed to within a hundredth
_SETTLED_M = 1e-7


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """Anterior, proximal and right unit vectors, heights above the distal end, width of the condyles."""

    x: Array
    y: Array
    z: Array
    height: Array
    width: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Knee:
    """What was found at the distal end, in the surface's own frame, m."""

    frame: _Frame
    low: fits.SphereOnBone  # to the subject's left
    high: fits.SphereOnBone  # to the subject's right
    cylinder: fits.CylinderOnBone | None
    distal: NDArray[np.bool_]

    @property
    def axis(self) -> Array:
        """Unit vector to the subject's right."""
        offset = self.high.centre - self.low.centre
        return np.asarray(offset / np.linalg.norm(offset))

    @property
    def centre(self) -> Array:
        """Midpoint of both spheres' centres."""
        return np.asarray(0.5 * (self.low.centre + self.high.centre))

    @property
    def least_covered(self) -> float:
        """Covered share of the sphere that has less."""
        return min(self.low.covered, self.high.covered)


def find_knee(surface: Surface, distal_end: float, rightward: Array | None = None) -> Knee | str:
    """Spheres on both condyles at one end of the bone, or why there are none.

    ``distal_end``: 1 for the end of largest x, -1 for the other. ``rightward``: (3,), roughly to the
    subject's right, of a bone whose shaft is missing; else the shaft tells front from back.
    """
    up = np.array([-distal_end, 0.0, 0.0])
    height = surface.smooth @ up
    height = height - height.min()
    distal = height < DISTAL_M
    block = surface.part(distal)
    z = block.widest_direction(across=up)
    width = float(np.ptp(block.smooth @ z))
    if not 0.05 <= width <= 0.12:  # bicondylar breadth 78.5 (3.0) to 88.6 (4.2) mm; a child's to a giant's
        return f"the distal end is {1e3 * width:.0f} mm wide; condyles are 50-120 mm"
    total = float(height.max())
    shaft = (height > 1.5 * DISTAL_M) & (height < min(0.6 * total, 0.25))
    if total < _SHORT_M:
        shaft = (height > 1.2 * DISTAL_M) & (height > total - _END_M)
    if rightward is None and int(shaft.sum()) < 50:
        return "there is too little shaft above the condyles to tell front from back"
    x = np.cross(up, z)
    if rightward is not None:
        ahead = float(np.cross(up, rightward) @ x)
    else:
        ahead = float((surface.middle(shaft) - block.middle()) @ x)
    x = x * np.sign(ahead)
    z = np.cross(x, up)
    if abs(ahead) < 3e-3:
        return "the condyles do not stand behind the shaft, so front and back are not clear"
    found = _fit_both_spheres(surface, _Frame(x=x, y=up, z=z, height=height, width=width))
    if isinstance(found, str):
        return found
    frame, low, high = found
    poor = _doubt_condyles(low, high, width)
    if poor is not None:
        return poor
    knee = Knee(frame=frame, low=low, high=high, cylinder=None, distal=distal)
    on_arc = _weigh_arc(surface.smooth - knee.centre, frame) > 0.5
    within = (_select_half(surface, frame, -1.0) | _select_half(surface, frame, 1.0)) & on_arc
    radius = 0.5 * (low.radius + high.radius)
    cylinder = fits.refine_cylinder(
        surface, knee.centre, knee.axis, radius, ridge=CYLINDER_RIDGE, within=within
    )
    if cylinder is not None and abs(float(cylinder.direction @ knee.axis)) < _APART:
        return f"sphere axis and cylinder axis differ by more than {MOST_APART_DEG:.0f} degrees"
    return Knee(frame=frame, low=low, high=high, cylinder=cylinder, distal=distal)


def _doubt_condyles(low: fits.SphereOnBone, high: fits.SphereOnBone, width: float) -> str | None:
    for ball in (low, high):
        if not CONDYLE_RADII_M[0] <= ball.radius <= CONDYLE_RADII_M[1]:
            return f"a condyle's sphere has a radius of {1e3 * ball.radius:.0f} mm"
        if ball.rms > 0.06 * ball.radius:  # chosen: twice that of rough MRI
            return f"a condyle is off its sphere by {1e3 * ball.rms:.1f} mm rms"
        if ball.covered < 0.06:  # chosen: a third of a good condyle
            return f"a condyle covers {ball.covered:.2f} of its sphere"
    if max(low.radius, high.radius) > 1.35 * min(low.radius, high.radius):  # chosen; equal within 10 %
        return f"the condyles' radii are {1e3 * low.radius:.0f} and {1e3 * high.radius:.0f} mm"
    apart = float(np.linalg.norm(low.centre - high.centre))
    if not 0.35 * width <= apart <= 0.85 * width:
        return f"the condyles' centres lie {1e3 * apart:.0f} mm apart on a knee {1e3 * width:.0f} mm wide"
    return None


def _fit_both_spheres(
    surface: Surface, frame: _Frame
) -> tuple[_Frame, fits.SphereOnBone, fits.SphereOnBone] | str:
    """Spheres and their common axis in turn, until both stay."""
    pair: tuple[shapes.SphereFit, shapes.SphereFit] | None = None
    for step in range(_STEPS):
        widening = 1.0 + _WIDE * _CLOSING**step
        halves = [_select_half(surface, frame, sign) for sign in (-1.0, 1.0)]
        if not (halves[0].any() and halves[1].any()):
            return "one condyle is missing"
        if pair is None:
            pair = _guess_sphere(surface, frame, halves[0]), _guess_sphere(surface, frame, halves[1])
        chosen = [
            _weigh_vertices(surface, frame, half, ball, widening)
            for half, ball in zip(halves, pair, strict=True)
        ]
        if min(int((weight > 0).sum()) for weight in chosen) < _FEWEST:
            return "no sphere fits the back of a condyle"
        # Both spheres through their vertices, each worth as many observations as it has grains of area.
        # Noise that was smoothed off is counted in: what is left of it is alike over more than one grain.
        points = [surface.points[weight > 0] for weight in chosen]
        counts = [(weight * surface.areas)[weight > 0] / GRAIN_M**2 for weight in chosen]
        rms = float(np.hypot(pair[0].rms, pair[1].rms)) / np.sqrt(2.0)
        noise = max(_LEAST_NOISE_M, float(np.hypot(rms, surface.noise)))
        new = shapes.fit_sphere_pair(*points, *counts, starts=pair, alike=ALIKE_M, noise=noise)
        settled = max(float(np.linalg.norm(a.centre - b.centre)) for a, b in zip(new, pair, strict=True))
        pair = new
        axis = pair[1].centre - pair[0].centre
        axis = axis / np.linalg.norm(axis)
        if not (pair[0].converged and float(axis @ frame.z) > 0.7):
            return "the condyles' centres do not lie side by side"
        x = np.cross(frame.y, axis)
        frame = _Frame(x=x / np.linalg.norm(x), y=frame.y, z=axis, height=frame.height, width=frame.width)
        if settled < _SETTLED_M and step > _CLOSED:
            break
    if pair is None:
        return "no sphere fits the back of a condyle"
    balls = [
        fits.SphereOnBone(
            centre=ball.centre,
            radius=ball.radius,
            rms=ball.rms,
            covered=fits.measure_coverage(surface, ball.centre, weight),
            support=weight,
        )
        for ball, weight in zip(pair, chosen, strict=True)
    ]
    return frame, balls[0], balls[1]


def _weigh_vertices(
    surface: Surface, frame: _Frame, half: NDArray[np.bool_], ball: shapes.SphereFit, widening: float
) -> Array:
    """Weight of every vertex: on the arc, facing across the axis, near the sphere; all with soft limits."""
    weight = np.zeros(len(surface.points))
    offset = surface.smooth[half] - ball.centre
    normals = surface.normals[half]
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
    limit = widening * CONDYLE_BAND * ball.radius
    ridge = min(widening * SPHERE_RIDGE, 0.8)
    gap = (distance - ball.radius) / limit
    facing = np.einsum("ij,ij->i", offset, normals) / distance
    weight[half] = (
        np.where(np.abs(gap) < 1.0, (1.0 - gap**2) ** 2, 0.0)
        * _rise_smoothly(facing, _FACING)
        * _rise_smoothly(-np.abs(normals @ frame.z), (-ridge - _LEAN, -ridge + _LEAN))
        * _weigh_arc(offset, frame)
    )
    return weight


def _weigh_arc(offset: Array, frame: _Frame) -> Array:
    up = np.cross(frame.z, frame.x)
    angle = np.rad2deg(np.arctan2(offset @ up, -(offset @ frame.x)))
    low, high = ARC_DEG
    return _rise_smoothly(angle, (low - _BLUR_DEG, low + _BLUR_DEG)) * _rise_smoothly(
        -angle, (-high - _BLUR_DEG, -high + _BLUR_DEG)
    )


def _rise_smoothly(value: Array, limits: tuple[float, float]) -> Array:
    """0 below, 1 above, smooth between."""
    share = np.clip((value - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0)
    smooth: Array = share * share * (3.0 - 2.0 * share)
    return smooth


def _select_half(surface: Surface, frame: _Frame, sign: float) -> NDArray[np.bool_]:
    """One condyle's side of the notch, near the distal end."""
    along = surface.smooth @ frame.z
    ends = along[frame.height < DISTAL_M]
    middle = 0.5 * float(ends.max() + ends.min())
    chosen: NDArray[np.bool_] = (sign * (along - middle) > _NOTCH * frame.width) & (
        frame.height < 0.8 * frame.width
    )
    return chosen


def _guess_sphere(surface: Surface, frame: _Frame, half: NDArray[np.bool_]) -> shapes.SphereFit:
    """A sphere inside the most posterior point of a condyle; a radius of a quarter of the width is usual."""
    candidates = np.flatnonzero(half)
    rear = surface.smooth[candidates[int(np.argmin(surface.smooth[candidates] @ frame.x))]]
    radius = 0.25 * frame.width
    return shapes.SphereFit(rear + radius * frame.x, radius, _FIRST_NOISE_M, converged=True)
