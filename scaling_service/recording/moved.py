"""Markers that sit elsewhere on their segment in one recording than in others: knocked, or stuck on again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from scaling_service.model.trial import Trial
from scaling_service.recording.exchanged import EXPLAINED, Clusters, Shape, find_exchanges, measure_shape

MOVED_M = 0.02
"""Chosen: a distance within a segment whose median differs by more between recordings is no skin alone where
the segment's other markers keep theirs (over a greater trochanter, hip against knee bending: 15 mm)."""

FEWEST = 4
"""Markers of a segment from which one can be told to have moved (chosen: three others are a shape)."""

TOLD_BY = 2
"""Neighbours from which its distance must differ (chosen: of one distance, either end may be wrong)."""

_FRAMES = 500  # of a recording, evenly: a median needs no more (chosen)


@dataclass(frozen=True, slots=True)
class MovedMarker:
    """A marker of a recording that alone contradicts the shape which its segment has in others.

    ``neighbour``, ``here_m``, ``there_m``: the distance that differs most, and in which recording
    (``other``). ``left_m``: the largest difference among the other markers of the segment.
    """

    trial: str
    label: str
    neighbour: str
    here_m: float
    there_m: float
    left_m: float
    other: str

    def __str__(self) -> str:
        here, there, left = (f"{1e3 * value:.0f} mm" for value in (self.here_m, self.there_m, self.left_m))
        return (
            f"{self.trial}: {self.label} lies {here} from {self.neighbour}, and {there} in {self.other}, "
            f"while the others on that segment keep their distances within {left}: it was knocked, stuck on "
            "again, or is another"
        )


def find_moved_markers(trials: Sequence[Trial], clusters: Clusters) -> Iterator[MovedMarker]:
    """Markers that sit elsewhere in a recording than in more than half of the others.

    ``trials``: in m. Of two recordings that contradict each other the first tells. Labels that stand for each
    other are for :func:`find_exchanges`, and tell nothing here.
    """
    some = [_thin(trial, max(1, trial.n_frames // _FRAMES)) for trial in trials]
    shapes = {trial.name: measure_shape([trial], clusters) for trial in some}
    told: set[tuple[str, str]] = set()
    for trial in some:
        others = [name for name in shapes if name != trial.name]
        found = list(_moved_in(trial.name, shapes, others, clusters)) if others else []
        if found:
            usual = measure_shape((other for other in some if other is not trial), clusters)
            exchanged = {label for item in find_exchanges(trial, clusters, usual) for label in item.labels}
            found = [item for item in found if exchanged.isdisjoint((item.label, item.neighbour))]
        yield from (item for item in found if (item.label, item.other) not in told)
        told |= {(item.label, item.trial) for item in found}


def _thin(trial: Trial, step: int) -> Trial:
    """Every so many frames of a recording."""
    return replace(
        trial,
        times=trial.times[::step],
        markers=trial.markers[::step],
        rate_hz=trial.rate_hz / step,
    )


def _moved_in(
    trial: str, shapes: Mapping[str, Shape], others: Sequence[str], clusters: Clusters
) -> Iterator[MovedMarker]:
    for labels in clusters.values():
        for label in labels:
            known = [_compare(label, labels, trial, other, shapes) for other in others]
            told = [one for one in known if one is not None]
            moved = [one for one, alone in told if alone]
            if 2 * len(moved) > len(told):
                yield max(moved, key=lambda one: abs(one.here_m - one.there_m))


def _compare(
    label: str, labels: Sequence[str], trial: str, other: str, shapes: Mapping[str, Shape]
) -> tuple[MovedMarker, bool] | None:
    """The marker beside another recording, and whether it alone moved; None where that cannot be told."""
    here, there = shapes[trial], shapes[other]
    change = {pair: abs(here[pair] - there[pair]) for pair in here if pair in there and {*pair} <= {*labels}}
    own = {pair: size for pair, size in change.items() if label in pair}
    if len(own) < FEWEST - 1:
        return None
    worst = max(own, key=own.__getitem__)
    left = max(size for pair, size in change.items() if label not in pair)
    told_by = sum(size > EXPLAINED * own[worst] for size in own.values())
    alone = own[worst] > MOVED_M and left < EXPLAINED * own[worst] and told_by >= TOLD_BY
    (neighbour,) = {*worst} - {label}
    return MovedMarker(trial, label, neighbour, here[worst], there[worst], left, other), alone
