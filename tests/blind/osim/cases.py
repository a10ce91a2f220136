"""Which cases the bank by OpenSim holds, and what is hidden in each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.blind.body import Array, Body, Move, Segment, times
from tests.blind.cases import SIZES, Case
from tests.blind.effects import EFFECTS
from tests.blind.effects.marker_swap import MarkerSwap
from tests.blind.effects.missing_dof import MissingDof
from tests.blind.effects.segment_length import SegmentLength
from tests.blind.effects.soft_tissue_artefact import SoftTissueArtefact
from tests.blind.hidden import Hidden, Scene, direction, one, sign
from tests.blind.osim.disturbances import DISTURBANCES
from tests.blind.osim.engine import OsimBody
from tests.blind.osim.unseen import UNSEEN
from tests.blind.strangers import STRANGERS

KINDS = DISTURBANCES | UNSEEN
"""Disturbances that this bank draws itself."""

NULLS = ("white", "autocorrelated")
BY_ANY_ENGINE = ("lens_distortion", "vibrating_camera", "clock_drift", "plate_saturation")
"""Strangers of the other bank that fit walking and squats on the ground."""

JOINTS = {"knee_r": "walker_knee_r", "knee_l": "walker_knee_l"}
"""The other bank's names, and this model's."""

HINGE = "x"
"""Of a knee in its joint's frame."""

NEIGHBOURS = (
    ("r_knee", "r_mknee"), ("L_ankle", "L_mankle"), ("r_thigh1", "r_thigh2"), ("L_thigh2", "L_thigh3"),
    ("r_sh2", "r_sh3"), ("r.PSIS", "L.PSIS"), ("r_toe", "r_5meta"),
)  # fmt: skip
"""Markers whose labels are exchanged."""


@dataclass(frozen=True, kw_only=True)
class BodyMass(Hidden):
    """``factor``: the whole person is heavier than the model by it."""

    def body(self, body: Body) -> Body:
        return replace(body, segments=tuple(map(self._heavier, body.segments)))

    def _heavier(self, segment: Segment) -> Segment:
        factor = self.parameters["factor"]
        x, y, z = (times(row, factor) for row in segment.inertia)
        return replace(segment, mass=factor * segment.mass, inertia=(x, y, z))


@dataclass(frozen=True, kw_only=True)
class ScaledSegment(SegmentLength):
    """The same done by OpenSim: places of joints in both their segments, and how they glide."""

    def body(self, body: Body) -> Body:
        assert isinstance(body, OsimBody)
        scaled = ((self.where[0], self.parameters["factor"]),)
        return replace(body, markers=super().body(body).markers, scales=(*body.scales, *scaled))


@dataclass(frozen=True, kw_only=True)
class HingeTilt(Hidden):
    """``y_deg``, ``z_deg``: the axis of a knee turned in its joint's frame, of which it is x."""

    def body(self, body: Body) -> Body:
        y, z = (float(np.deg2rad(self.parameters[f"{a}_deg"])) for a in "yz")
        joint = body.of_joint(self.where[0])
        Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        there = (Move("turn", Y, constant=y), Move("turn", Z, constant=z))
        back = (Move("turn", Z, constant=-z), Move("turn", Y, constant=-y))
        return body.with_segment(replace(joint, moves=(*there, *joint.moves, *back)))


@dataclass(frozen=True, kw_only=True)
class SkinOfTwoJoints(SoftTissueArtefact):
    """``x_mm_per_deg_hip_flexion_r`` ...: times several drivers at once."""

    def on_skin(self, scene: Scene, markers: Array) -> Array:
        for driver in self.driver:
            gains = {f"{a}_mm_per_deg": self.parameters[f"{a}_mm_per_deg_{driver}"] for a in "xyz"}
            one_by_one = SoftTissueArtefact(
                kind=self.kind, where=self.where, parameters=gains, driver=(driver,)
            )
            markers = one_by_one.on_skin(scene, markers)
        return markers


def cases() -> list[Case]:
    """Every effect in two sizes, two disturbances of each kind, twenty recordings with nothing."""
    kinds = list(dict.fromkeys([*EFFECTS, *OWN]))
    all_ = [_case("effect", kind, size, k) for k, kind in enumerate(kinds) for size in SIZES[1:]]
    all_ += [_case("null", NULLS[k % 2], "none", k) for k in range(20)]
    strange = (*BY_ANY_ENGINE, *KINDS)
    return all_ + [_case("stranger", kind, "large", k + n) for k, kind in enumerate(strange) for n in (0, 1)]


def sample() -> list[Case]:
    """A few of them: an effect that forces show, and nothing."""
    wanted = {"force_delay", "white"}
    chosen = [c for c in cases() if c.kinds[0] in wanted and c.size in {"large", "none"}]
    return list({c.kinds: c for c in reversed(chosen)}.values())


def drawn(case: Case, body: Body, rng: np.random.Generator) -> tuple[Hidden, ...]:
    """What is hidden in a case; sizes are 0.75 to 1.35 times the nominal ones."""
    if case.group == "null":
        return ()
    kind, level = case.kinds[0], SIZES.index(case.size)
    spread = float(np.exp(rng.uniform(-0.3, 0.3)))
    if kind in KINDS:
        return (KINDS[kind](body, rng),)
    if kind in OWN:
        sizes, draw = OWN[kind]
        return (draw(body, sizes[level] * spread, rng),)
    effect = (EFFECTS | STRANGERS)[kind]
    return (_named_here(effect.draw(body, effect.sizes[level] * spread, rng)),)


def _body_mass(_body: Body, size: float, rng: np.random.Generator) -> Hidden:
    return BodyMass(kind="body_mass", where=("world",), parameters={"factor": 1 + sign(rng) * size})


def _named_here(hidden: Hidden) -> Hidden:
    """The same by this model's names; skin of a cluster is of its own markers, not those at the joints."""
    where = tuple(JOINTS.get(name, name) for name in hidden.where)
    if len(where) > 1 and hidden.kind in {"soft_tissue_artefact", "skin_wobble"}:
        where = _cluster(where)
    if isinstance(hidden, SegmentLength):
        return ScaledSegment(kind=hidden.kind, where=where, parameters=hidden.parameters)
    if isinstance(hidden, MissingDof) and "rms_deg" in hidden.parameters and hidden.axis == HINGE:
        return replace(hidden, where=where, axis="z")
    return replace(hidden, where=where)


def _cluster(markers: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(m for m in markers if "thigh" in m or "_sh" in m)


def _skin_of_two_joints(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    side = one(rng, ["r", "l"])
    drivers = f"hip_flexion_{side}", f"knee_angle_{side}"
    parameters = {
        f"{a}_mm_per_deg_{driver}": float(v)
        for driver in drivers
        for a, v in zip("xyz", size * direction(rng), strict=True)
    }
    where = _cluster(body.on(f"femur_{side}"))
    return SkinOfTwoJoints(kind="soft_tissue_artefact", where=where, parameters=parameters, driver=drivers)


def _hinge_tilt(_body: Body, size: float, rng: np.random.Generator) -> Hidden:
    angle = rng.uniform(0, 2 * np.pi)
    parameters = {"y_deg": float(size * np.cos(angle)), "z_deg": float(size * np.sin(angle))}
    where = (one(rng, list(JOINTS.values())),)
    return HingeTilt(kind="joint_axis_tilt", where=where, parameters=parameters)


def _swap(_body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """In all trials; they are as short as a second."""
    start = float(np.round(rng.uniform(0.1, 0.3), 2))
    parameters = {"start_s": start, "end_s": float(np.round(start + size, 2))}
    pair = NEIGHBOURS[rng.integers(len(NEIGHBOURS))]
    return MarkerSwap(kind="marker_swap", where=pair, parameters=parameters)


def _contact(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Within recordings that are as short as a second."""
    start, end = (float(np.round(rng.uniform(*ends), 2)) for ends in ((0.05, 0.2), (0.6, 0.8)))
    drawn = EFFECTS["external_contact"].draw(body, size, rng)
    return replace(drawn, parameters={"start_s": start, "end_s": end, "rms_N": size})


def _case(group: str, kind: str, size: str, seed: int) -> Case:
    return Case(group, (kind,), size, "real by OpenSim", forces=True, seed=seed)


OWN: dict[str, tuple[tuple[float, float, float], Callable[[Body, float, np.random.Generator], Hidden]]] = {
    "body_mass": ((0.02, 0.04, 0.08), _body_mass),
    "external_contact": (EFFECTS["external_contact"].sizes, _contact),
    "joint_axis_tilt": (EFFECTS["joint_axis_tilt"].sizes, _hinge_tilt),
    "marker_swap": ((0.1, 0.2, 0.4), _swap),
    "skin_of_two_joints": (EFFECTS["soft_tissue_artefact"].sizes, _skin_of_two_joints),
}
"""Kinds that this bank draws itself: sizes, and how."""
