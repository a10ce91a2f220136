"""A joint that moves in a way that the model locks: a turn or shift that may take any value in any frame."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
import scipy

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.apply import name_freedom
from scaling_service.capabilities.discovery.laws.candidates import Candidate, Estimate, FreeMotion
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.spots import At, JointSpot
from scaling_service.capabilities.discovery.observations.tracked import MotionFit
from scaling_service.capabilities.discovery.ordinary.body import find_part
from scaling_service.capabilities.discovery.ordinary.columns import Base
from scaling_service.capabilities.discovery.ordinary.levels import weigh_level
from scaling_service.capabilities.discovery.ordinary.sums import White, weigh_markers
from scaling_service.core.arrays import Array

KIND = "missing_dof"
_EVERYDAY = {"rotation": math.radians(3.0), "translation": 0.004}
"""By what a joint strays from a model of fewer freedoms at level one (knee, beside flexion, from pins: 3 to
10 deg and mm in all: Lafortune 1992, Reinschmidt 1997)."""

_LARGE = {
    "rotation": math.radians(7.5),
    "translation": 0.0075,
}  # half of what ``effect_sizes.yaml`` says is met
_FACTORS = np.geomspace(1.0, 40.0, 9)  # by which it may be livelier at one joint
_SHOWN = 1e-3  # share of a direction's square below which the pose hides it
_DIRECTION = math.log(10.0)  # chosen: directions in space that are told apart at 20 deg

_PLACES: tuple[tuple[At, Literal["rotation", "translation"]], ...] = (
    ("before", "rotation"),
    ("after", "rotation"),
    ("start", "translation"),
)

_NOTES = {"before": "extra turn", "after": "extra turn about own axes", "start": "extra shift"}


def find_free_motions(
    scene: Scene, base: Base, whites: Sequence[tuple[White, Array]], levels: Mapping[str, float]
) -> Iterator[tuple[float, Candidate]]:
    """Every joint that turns, with its best directions of turning and of shifting, and their log odds.

    ``whites``: of every recording, with residuals (n, 3 m) less everything ordinary that lasts.
    """
    numbers = {spot: k for k, spot in enumerate(base.spots)}
    jointed = scene.jointed
    for segment in jointed:
        level = min(levels.get(f"glide {find_part(scene.model.bone_of(segment.name))}", 1.0), 1.0)
        for at, kind in _PLACES:
            rows = [numbers[JointSpot(segment.name, at, kind, k)] for k in range(3)]
            found = _weigh_course(whites, rows, level * _EVERYDAY[kind], _LARGE[kind])
            if found is not None:
                odds, axis = found
                motion = FreeMotion(segment.name, at, kind, axis)
                candidate = Candidate(
                    kind=KIND, where=(segment.joint_name,), columns=(), note=_NOTES[at], change=motion
                )
                yield odds - math.log(len(_PLACES) * len(jointed)) - _DIRECTION, candidate


def _weigh_course(
    whites: Sequence[tuple[White, Array]], rows: Sequence[int], everyday: float, large: float
) -> tuple[float, tuple[float, float, float]] | None:
    """Log Bayes factor of a motion of any course along the best direction, against the everyday one."""
    scores, products, weights, raw = [], [], [], 0.0
    edges = np.cumsum([len(left) for _, left in whites])[:-1]
    for white, left in whites:
        columns = white.columns[:, rows]
        scores.append(np.matmul(columns, left[:, :, None])[:, :, 0])
        products.append(np.matmul(columns, columns.transpose(0, 2, 1)))
        weights.append(np.full(len(left), white.look.weight))
        raw += float(np.square(white.look.columns[:, rows]).sum())
    x, X, w = np.concatenate(scores), np.concatenate(products), np.concatenate(weights)
    shown = np.einsum("n,nij->ij", w, X)
    if np.trace(shown) <= 0.0:
        return None
    size = np.trace(shown) / 3.0
    _, vectors = scipy.linalg.eigh(np.einsum("n,ni,nj->ij", w, x, x), shown + _SHOWN * size * np.eye(3))
    axis = vectors[:, -1] / np.linalg.norm(vectors[:, -1])
    along, bend = x @ axis, np.einsum("i,nij,j->n", axis, X, axis)
    if float(w @ bend) < _SHOWN * size:
        return None

    moving = [np.einsum("nka,k->na", white.columns[:, rows], axis) for white, _ in whites]

    def weigh(sd: float) -> float:
        """With markers that may wander more than their part does, each by itself, beside the motion."""
        more = sd * sd
        value = 0.5 * float(w @ (along**2 * more / (1.0 + more * bend) - np.log1p(more * bend)))
        course = np.split(more * along / (1.0 + more * bend), edges)
        rests = [
            (white, left - size[:, None] * columns)
            for (white, left), columns, size in zip(whites, moving, course, strict=True)
        ]
        energy = math.fsum(float(white.measure(rest).sum()) for white, rest in rests)
        return value + float(weigh_markers(rests)) + 0.5 * energy

    ordinary = max(weigh(factor * everyday) + weigh_level(factor) for factor in _FACTORS.tolist())
    i, j, k = axis.tolist()
    return weigh(large) - ordinary, (i, j, k)


def _describe_motion(effect: Estimate, after: Fit) -> Mapping[str, float]:
    """How much it moves, and along which axis."""
    motion = effect.candidate.change
    assert isinstance(motion, FreeMotion)
    course = np.concatenate(_list_courses(after.tracked, effect.candidate))
    return {
        **_size_in_results(motion, float(np.sqrt(np.square(course).mean()))),
        **dict(zip(("axis_x", "axis_y", "axis_z"), motion.axis, strict=True)),
    }


def _list_courses(tracked: Sequence[MotionFit], candidate: Candidate) -> list[Array]:
    """What the new coordinate does in every recording, (n,) each."""
    name = name_freedom(candidate)
    return [item.q[:, item.task.model.coordinate_names.index(name)] for item in tracked]


def _estimate_motion_spreads(effect: Estimate, after: Fit) -> Mapping[str, float]:
    """How well its RMS is known: from how it differs between blocks of time."""
    motion = effect.candidate.change
    assert isinstance(motion, FreeMotion)
    squares = [
        float(np.square(course[rows]).mean())
        for item, course in zip(after.tracked, _list_courses(after.tracked, effect.candidate), strict=True)
        for rows in item.blocks(after.settings.block_s)
    ]
    sd = float(np.std(squares, ddof=1) / math.sqrt(len(squares)) / (2.0 * math.sqrt(np.mean(squares))))
    return _size_in_results(motion, sd) if np.isfinite(sd) else {}


def _size_in_results(motion: FreeMotion, size: float) -> Mapping[str, float]:
    """In the units of results."""
    return {"rms_deg": math.degrees(size)} if motion.kind == "rotation" else {"rms_mm": 1e3 * size}


EFFECTS = (
    Effect(
        kind=KIND,
        meaning="the joint moves in a way that the model locks",
        details=_describe_motion,
        spreads=_estimate_motion_spreads,
    ),
)
