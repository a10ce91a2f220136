"""Markers that sit elsewhere on their segment in one recording than in others: knocked, or stuck on again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from scaling_service.model.trial import Trial
from scaling_service.recording.exchanged import EXPLAINED, Clusters, Shape, measure_shape

MOVED_M = 0.02
"""Chosen: a distance within a segment whose median differs by more between recordings is no skin alone where
the segment's other markers keep theirs (over a greater trochanter, hip against knee bending: 15 mm)."""

FEWEST = 4
"""Markers of a segment from which one can be told to have moved (chosen: three others are a shape)."""

TOLD_BY = 2
"""Neighbours from which its distance must differ (chosen: of one distance, either end may be wrong)."""


@dataclass(frozen=True, slots=True)
class MovedMarker:
    """A marker that alone contradicts the shape which its segment has in other recordings.

    ``neighbour``, ``here_m``, ``there_m``: the distance that differs most, and in which recording
    (``other``). ``left_m``: the largest difference among the other markers of the segment.
    """

    label: str
    neighbour: str
    here_m: float
    there_m: float
    left_m: float
    other: str


def find_moved_markers(
    trials: Mapping[str, Trial], clusters: Mapping[str, Clusters]
) -> Iterator[tuple[str, MovedMarker]]:
    """Recordings, and the markers that sit elsewhere there than in more than half of the others.

    ``trials``: in m, by file; ``clusters``: of each. Of two recordings that contradict each other both
    come.
    """
    shapes = {file: measure_shape([trial], clusters[file]) for file, trial in trials.items()}
    for file, labels in ((file, labels) for file, parts in clusters.items() for labels in parts.values()):
        others = [name for name in shapes if name != file]
        for label in labels:
            asked = [_compare(label, labels, shapes[file], shapes[name], name) for name in others]
            known = [found for found in asked if found is not None]
            moved = [one for one, is_moved in known if is_moved]
            if 2 * len(moved) > len(known):
                yield file, max(moved, key=lambda one: abs(one.here_m - one.there_m))


def _compare(
    label: str, labels: Sequence[str], here: Shape, there: Shape, other: str
) -> tuple[MovedMarker, bool] | None:
    """The marker beside another recording, and whether it alone moved; None where that cannot be told."""
    change = {pair: abs(here[pair] - there[pair]) for pair in here if pair in there and {*pair} <= {*labels}}
    own = {pair: size for pair, size in change.items() if label in pair}
    if len(own) < FEWEST - 1:
        return None
    worst = max(own, key=own.__getitem__)
    left = max(size for pair, size in change.items() if label not in pair)
    told_by = sum(size > EXPLAINED * own[worst] for size in own.values())
    alone = own[worst] > MOVED_M and left < EXPLAINED * own[worst] and told_by >= TOLD_BY
    (neighbour,) = {*worst} - {label}
    return MovedMarker(label, neighbour, here[worst], there[worst], left, other), alone
