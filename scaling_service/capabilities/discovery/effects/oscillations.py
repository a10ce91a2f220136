"""Skin under markers, or part of a segment's mass, that oscillates when the segment accelerates."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.effects.sizes import list_usual_deviations
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws.candidates import (
    SHAPES,
    TRIED,
    Candidate,
    Column,
    Estimate,
    Part,
    describe_oscillation,
)
from scaling_service.capabilities.discovery.laws.loads import Wobbling
from scaling_service.capabilities.discovery.laws.profiles import Oscillation, evaluate_profiles
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.laws.spots import MarkerSpot
from scaling_service.capabilities.discovery.ordinary.body import find_part
from scaling_service.capabilities.discovery.ordinary.columns import Base
from scaling_service.capabilities.discovery.ordinary.levels import FACTORS, weigh_level
from scaling_service.capabilities.discovery.ordinary.odds import Scored
from scaling_service.capabilities.discovery.ordinary.sums import White
from scaling_service.numerics.multibody.laws import Array

_LONG_M = (
    0.2  # from a segment's origin to its centre of mass; chosen: half of it is more than a hand's breadth
)


_EVERYBODYS = 0.5  # of the skin that wobbles: what everybody's does (chosen)


def propose_wobbling_skin(scene: Scene) -> Iterator[Candidate]:
    """Every marker and the groups of every segment, at each frequency and damping tried."""
    for segment in scene.bearing:
        for group in scene.groups_on(segment.name):
            for pair in TRIED:
                parts = tuple(
                    Part(MarkerSpot(m, k), Oscillation(m, *pair, k)) for m in group for k in range(3)
                )
                column = Column(name="share", unit=1.0, parts=parts, low=0.3, high=3.0, natural=1.0)
                yield Candidate(
                    kind="skin_wobble", where=group, columns=(column,), note=describe_oscillation(*pair)
                )


def find_wobbles(
    scene: Scene, base: Base, whites: Sequence[tuple[White, Array]], loose: Mapping[str, float]
) -> Iterator[tuple[float, Candidate, Scored]]:
    """Skin that wobbles, with its log odds against everybody's, which is livelier where skin wanders more.

    ``whites``: of every recording, with residuals (n, 3 m) less everything ordinary that lasts.
    """
    candidates = list(propose_wobbling_skin(scene))
    profiles = list(dict.fromkeys(p.profile for c in candidates for p in c.columns[0].parts))
    at = {profile: k for k, profile in enumerate(profiles)}
    spots = {spot: k for k, spot in enumerate(base.spots)}
    scores, products = np.zeros(len(candidates)), np.zeros(len(candidates))
    for white, left in whites:
        values = evaluate_profiles(profiles, white.look.item)[:, white.look.rows]
        for k, candidate in enumerate(candidates):
            parts = candidate.columns[0].parts
            rows, courses = [spots[p.spot] for p in parts], values[[at[p.profile] for p in parts]]
            moved = np.einsum("np,npr->nr", courses.T, white.columns[:, rows])
            scores[k] += white.look.weight * float((moved * left).sum())
            products[k] += white.look.weight * float(np.square(moved).sum())
    for k, candidate in enumerate(candidates):
        sd = list_usual_deviations(candidate, scene.model)
        assert sd is not None
        x, X = scores[k : k + 1], products[k : k + 1, None]
        part = find_part(scene.model.bone_of(scene.model.marker(candidate.where[0]).segment))
        everybodys = _EVERYBODYS * loose.get(part, 1.0) * sd
        ordinary = max(Scored.of(x, X, f * everybodys).bayes + weigh_level(f) for f in (1.0, *FACTORS))
        one = Scored.of(x, X, sd)
        yield one.bayes - ordinary - math.log(len(candidates)), candidate, one


def propose_wobbling_masses(scene: Scene) -> Iterator[Candidate]:
    """Every segment with mass, at each frequency and damping tried, at its centre or near its joint.

    Nearer only where that makes a difference: a belly hangs below the middle of the trunk.
    """
    for segment in scene.heavy:
        long = np.linalg.norm(segment.com) > _LONG_M
        for pair, along in product(TRIED, (1.0, 0.5) if long else (1.0,)):
            load = Wobbling(segment.name, *pair, along)
            column = Column(name="kg", unit=1.0, load=load, low=0.0, high=segment.mass)
            yield Candidate(
                kind="wobbling_mass",
                where=(segment.name,),
                columns=(column,),
                note=describe_oscillation(*pair),
            )


def _describe_oscillation(effect: Estimate, _after: Fit) -> Mapping[str, float]:
    """At which frequency and damping it oscillates."""
    pair = effect.candidate.oscillation
    assert pair is not None
    return dict(zip(SHAPES, pair, strict=True))


EFFECTS = (
    Effect(
        kind="skin_wobble",
        meaning="the skin under the marker oscillates when the segment accelerates",
        details=_describe_oscillation,
    ),
    Effect(
        kind="wobbling_mass",
        meaning="part of the segment's own mass oscillates on a spring",
        candidates=propose_wobbling_masses,
        details=_describe_oscillation,
    ),
)
