"""Part of a segment's mass that oscillates when the segment accelerates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np

from scaling_service.capabilities.discovery.effects.catalogue import Effect
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws import candidates
from scaling_service.capabilities.discovery.laws.loads import Wobbling
from scaling_service.capabilities.discovery.laws.scene import Scene

_LONG_M = (
    0.2  # from a segment's origin to its centre of mass; chosen: half of it is more than a hand's breadth
)


def propose_wobbling_masses(scene: Scene) -> Iterator[candidates.Candidate]:
    """Every segment with mass, at each frequency and damping tried, at its centre or near its joint.

    Nearer only where that makes a difference: a belly hangs below the middle of the trunk.
    """
    for segment in scene.heavy:
        long = np.linalg.norm(segment.com) > _LONG_M
        for pair, along in product(candidates.TRIED, (1.0, 0.5) if long else (1.0,)):
            column = candidates.Column(name="kg", unit=1.0, load=Wobbling(segment.name, *pair, along))
            note = candidates.describe_oscillation(*pair)
            yield candidates.Candidate("wobbling_mass", (segment.name,), (column,), note=note)


def describe_shape(effect: candidates.Estimate, _after: Fit) -> Mapping[str, float]:
    """At which frequency and damping it oscillates."""
    pair = effect.candidate.oscillation
    assert pair is not None
    return dict(zip(candidates.SHAPES, pair, strict=True))


EFFECTS = (
    Effect(
        "wobbling_mass",
        "part of the segment's own mass oscillates on a spring",
        propose_wobbling_masses,
        details=describe_shape,
    ),
)
