"""Which cases the bank holds."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

from tests.blind.clutter import NULLS
from tests.blind.effects import EFFECTS
from tests.blind.strangers import STRANGERS

MOVEMENTS = ("gait", "varied")
SIZES = ("small", "middle", "large")
NAMEABLE = "nameable"
"""A size of twice to four times what the case's own recordings can name (see ``nameable.py``)."""

PAIRS: tuple[tuple[str, str], ...] = (
    ("marker_offset", "soft_tissue_artefact"),
    ("marker_offset", "joint_axis_tilt"),
    ("segment_length", "marker_offset"),
    ("joint_centre_offset", "soft_tissue_artefact"),
    ("missing_dof", "marker_offset"),
    ("capture_scale", "soft_tissue_artefact"),
    ("force_delay", "plate_position"),
    ("plate_gain", "plate_position"),
    ("carried_load", "force_delay"),
    ("gravity_tilt", "plate_gain"),
    ("external_contact", "plate_position"),
    ("segment_com", "force_delay"),
)
"""Two effects at once."""

OPPOSED: tuple[tuple[str, str], ...] = (
    ("marker_offset", "soft_tissue_artefact"),
    ("plate_gain", "plate_bias"),
    ("plate_position", "plate_rotation"),
)
"""Two effects at one place that partly cancel: the second works against the first."""


@dataclass(frozen=True)
class Case:
    """A case: what is hidden, in which movement, how large and by which seed.

    Parameters
    ----------
    group : 'effect', 'null', 'pair', 'opposed', 'stranger' or 'check'
    kinds : names of effects or strangers; for nulls the kind of noise
    size : 'small', 'middle', 'large' or 'nameable'
    movement : 'gait' or 'varied'
    forces : bool
        Whether forces are recorded (then the model has feet).
    seed : int
    c3d : bool
        C3D files instead of TRC and MOT.
    real : bool
        Joint angles of real recordings.
    """

    group: str
    kinds: tuple[str, ...]
    size: str
    movement: str
    forces: bool
    seed: int
    c3d: bool = False
    real: bool = False

    @property
    def id(self) -> str:
        """A name that tells nothing."""
        text = " ".join(str(value) for value in dataclasses.astuple(self))
        return "case_" + hashlib.sha256(text.encode()).hexdigest()[:10]


def full(seeds: int = 10, nulls: int = 500) -> list[Case]:
    """21 kinds x 3 sizes x seeds x 2 movements; nulls; pairs, opposed ones, strangers with half the seeds."""
    cases = [
        _effect(kind, size, movement, seed, c3d=seed == 0)
        for kind in EFFECTS
        for size in SIZES
        for movement in MOVEMENTS
        for seed in range(seeds)
    ]
    cases += list(_nulls(nulls))
    some = max(1, seeds // 2)
    cases += [_pair("pair", kinds, seed) for kinds in PAIRS for seed in range(some)]
    cases += [_pair("opposed", kinds, seed) for kinds in OPPOSED for seed in range(some)]
    cases += [_stranger(kind, seed) for kind in STRANGERS for seed in range(some)]
    return cases


def nameable(seeds: int = 3, first: int = 0) -> list[Case]:
    """Each kind in both movements, as large as people as the yardstick let it be named; nulls; strangers."""
    chosen = range(first, first + seeds)
    cases = [_effect(kind, NAMEABLE, move, seed) for kind in EFFECTS for move in MOVEMENTS for seed in chosen]
    cases += list(_nulls(len(EFFECTS) * seeds, first * len(EFFECTS)))
    return cases + [_stranger(kind, seed) for kind in STRANGERS for seed in chosen]


def fast() -> list[Case]:
    """One large case a kind, two nulls of each noise, two pairs, one opposed pair, two strangers."""
    cases = [_effect(kind, "large", MOVEMENTS[k % 2], 0) for k, kind in enumerate(EFFECTS)]
    cases += list(_nulls(2 * len(NULLS)))
    cases += [_pair("pair", PAIRS[0], 0), _pair("pair", PAIRS[7], 0), _pair("opposed", OPPOSED[0], 0)]
    return [*cases, _stranger("marker_restuck", 0), _stranger("plate_saturation", 0)]


def checks() -> list[Case]:
    """Nothing hidden and no noise: what the product must find to fit exactly."""
    return [Case("check", ("nothing",), "none", m, f, 0) for m in MOVEMENTS for f in (False, True)]


def real_angles(seeds: int = 5) -> list[Case]:
    """Marker effects on joint angles of real walking, where the recordings are at hand."""
    kinds = [kind for kind, effect in EFFECTS.items() if effect.needs == "markers"]
    return [
        Case("effect", (kind,), size, "gait", False, seed, real=True)
        for kind in kinds
        for size in SIZES
        for seed in range(seeds)
    ]


def _effect(kind: str, size: str, movement: str, seed: int, *, c3d: bool = False) -> Case:
    forces = EFFECTS[kind].needs == "forces"
    return Case("effect", (kind,), size, movement, forces, seed, c3d and forces)


def _nulls(count: int, first: int = 0) -> Iterator[Case]:
    kinds = tuple(NULLS)
    for k in range(first, first + count):
        # Noise kinds alternate fastest, then forces or none, then the movement.
        noise, forces, movement = kinds[k % 4], bool(k // 4 % 2), MOVEMENTS[k // 8 % 2]
        yield Case("null", (noise,), "none", movement, forces, k)


def _pair(group: str, kinds: tuple[str, str], seed: int) -> Case:
    forces = any(EFFECTS[kind].needs == "forces" for kind in kinds)
    return Case(group, kinds, "large", MOVEMENTS[seed % 2], forces, seed)


def _stranger(kind: str, seed: int) -> Case:
    movement = "gait" if kind in {"slipping_sole", "belt_speed_error"} else MOVEMENTS[seed % 2]
    return Case("stranger", (kind,), "large", movement, STRANGERS[kind].needs == "forces", seed)
