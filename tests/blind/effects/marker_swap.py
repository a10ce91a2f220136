"""The labels of two markers are exchanged for a while."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.blind.body import Array, Body
from tests.blind.hidden import Effect, Hidden


@dataclass(frozen=True, kw_only=True)
class MarkerSwap(Hidden):
    """From ``start_s`` to ``end_s``, both included, in every trial that it affects."""

    def labelled(self, times: Array, labels: tuple[str, ...], markers: Array) -> Array:
        a, b = (labels.index(name) for name in self.where)
        when = (times >= self.parameters["start_s"] - 1e-9) & (times <= self.parameters["end_s"] + 1e-9)
        swapped = markers.copy()
        swapped[when, a], swapped[when, b] = markers[when, b], markers[when, a]
        return swapped


def draw(body: Body, size: float, rng: np.random.Generator) -> Hidden:
    """Two neighbours on one side, or the two PSIS; in all trials or, half of the draws, in the first."""
    pairs = [
        ("RLFE", "RMFE"),
        ("LLFE", "LMFE"),
        ("RLM", "RMM"),
        ("LLM", "LMM"),
        ("RPSIS", "LPSIS"),
        ("RLFE", "RFH"),
    ]
    pair = pairs[rng.integers(len(pairs))]
    start = float(np.round(rng.uniform(1.0, 2.0), 2))
    parameters = {"start_s": start, "end_s": start + size}
    trials = None if rng.random() < 0.5 else (0,)
    return MarkerSwap(kind="marker_swap", where=pair, parameters=parameters, trials=trials)


EFFECT = Effect("marker_swap", "markers", "s", (0.1, 0.4, 1.6), draw)
