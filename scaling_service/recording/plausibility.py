"""What cannot be true of a body or of its markers: units, strays, labels that are missing or moved."""

from __future__ import annotations

import dataclasses
from collections import abc
from typing import TypeVar

import numpy as np

from scaling_service.core.arrays import Array, Mask
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.trial import Repair, Trial, is_unlabelled, repair_each
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.recording.exchanged import EXPLAINED, Clusters, Shape, find_exchanges, measure_shape

_AnyTrial = TypeVar("_AnyTrial", bound=Trial)

PLAUSIBLE_EXTENT_M = (0.2, 5.0)
"""Largest extent of a body's markers (chosen: a child's shank, and arms stretched overhead, with reserve)."""

UNIT_MIXUPS = (1e-3, 1e3)
"""m that are mm, and mm that are m: the mix-ups that occur; their plausible ranges do not overlap."""

FARTHEST = 20.0
"""Distance from the middle of a frame's markers, over the typical one, beyond which a marker is no part of a
body (chosen: real recordings of whole bodies and of legs reach 2 to 5)."""

FEWEST = 4  # markers of a frame that tell where its middle is (chosen: of three, two may be the strays)

NEAR_M = 0.03
"""Chosen: a trajectory that goes on within this distance where a marker is lost is the marker's own."""

OVERLAP = 0.1  # chosen: share of its frames in which a trajectory may be seen beside the marker that it fills

MOVED_M = 0.02
"""Chosen: a distance within a segment whose median differs by more between recordings is no skin alone where
the segment's other markers keep theirs (over a greater trochanter, hip against knee bending: 15 mm)."""

FEWEST_OF_SEGMENT = 4
"""Markers of a segment from which one can be seen to have moved (chosen: three others are a shape)."""

TOLD_BY = 2
"""Neighbours from which its distance must differ (chosen: of one distance, either end may be wrong)."""

_FRAMES = 500  # of a recording, evenly: a median needs no more (chosen)


def find_unit_factor(trial: Trial) -> tuple[float, tuple[Repair, ...]]:
    """The factor that makes the size of the body plausible, 1 where the stated unit can be true.

    Raises TrialUnusable if no marker is seen at all, or neither the stated unit nor mm taken for m or m for
    mm gives a body.
    """
    low, high = find_extremes(trial.markers)
    largest = (high - low).max(axis=1)
    if not np.isfinite(largest).any():
        raise TrialUnusable(
            f"no marker is seen in any frame of trial '{trial.name}'",
            file=trial.name,
            remedy="Check the recording",
        )
    extent = float(np.median(largest[np.isfinite(largest)]))
    least, most = PLAUSIBLE_EXTENT_M
    if least <= extent <= most:
        return 1.0, ()
    for factor in UNIT_MIXUPS:
        if least <= extent * factor <= most:
            stated, true = ("m", "mm") if factor < 1 else ("mm", "m")
            detail = (
                f"the body would measure {extent:.3g} m; positions said to be in {stated} are in {true}, "
                f"so they were multiplied by {factor:g}"
            )
            return factor, (Repair("unit", trial.name, detail, frames=trial.n_frames),)
    if extent == 0 or len(trial.labels) < 2:
        return 1.0, ()
    raise TrialUnusable(
        f"the markers of trial '{trial.name}' extend over {extent:.3g} m, which is no body in m or mm",
        file=trial.name,
        field="Units",
        remedy="Correct the unit that the recording states, or its positions",
    )


def find_extremes(positions: Array) -> tuple[Array, Array]:
    """Smallest and largest coordinate among the markers of each frame, (n_frames, 3); NaN if none is seen."""
    known = np.isfinite(positions)
    low = np.where(known, positions, np.inf).min(axis=1, initial=np.inf)
    high = np.where(known, positions, -np.inf).max(axis=1, initial=-np.inf)
    none = ~known.any(axis=1)
    return np.where(none, np.nan, low), np.where(none, np.nan, high)


def remove_strays(trial: _AnyTrial) -> _AnyTrial:
    """Mark positions that no body can reach as not seen.

    A single one outweighs all other markers in a least-squares fit.

    ``trial``: in any axes and unit. Returns one Repair, ``stray``, for each marker concerned; the same
    trial where there is none.
    """
    shown = find_seen(trial.markers)
    rows = np.flatnonzero(shown.sum(axis=1) >= FEWEST)
    if not len(rows):
        return trial
    known = np.where(shown[rows, :, None], trial.markers[rows], np.nan)
    # Median over the markers (n, m, 3) that are known, (n, 1, 3); numpy's own takes ten times as long.
    ordered = np.sort(known, axis=1)  # NaN last
    count = np.isfinite(known[..., 0]).sum(axis=1)[:, None, None]
    low, high = (np.take_along_axis(ordered, half, axis=1) for half in ((count - 1) // 2, count // 2))
    distance = np.linalg.norm(known - (0.5 * (low + high)), axis=2)
    flags = np.zeros_like(shown)
    flags[rows] = distance > FARTHEST * np.median(distance[shown[rows]])
    if not flags.any():
        return trial
    detail = f"over {FARTHEST:g} times farther from the other markers than usual, taken as not seen"
    repairs = repair_each(flags, trial.labels, "stray", detail)
    markers = np.where(flags[..., None], np.nan, trial.markers)
    return trial.with_markers(markers, *repairs)


@dataclasses.dataclass(frozen=True, slots=True)
class Unlabelled:
    """One trajectory without a label."""

    label: str  # as the file has it
    frames: int  # in which it is seen
    fills: str | None = None  # the marker in whose gaps it lies
    filled: int = 0  # frames of those gaps that it shows


def find_unlabelled(trial: Trial) -> abc.Iterator[Unlabelled]:
    """The trajectories without a label, each with the marker that it seems to be.

    ``trial``: in m.
    """
    shown = find_seen(trial.markers)
    named = [k for k, label in enumerate(trial.labels) if not is_unlabelled(label)]
    for k, label in enumerate(trial.labels):
        if k in named or not shown[:, k].any():
            continue
        best = min(
            (_measure_distance_in_gaps(trial.markers, shown, k, other) for other in named),
            default=(float("inf"), 0, 0),
        )
        frames = int(shown[:, k].sum())
        if best[0] <= NEAR_M:
            yield Unlabelled(label, frames, trial.labels[best[1]], best[2])
        else:
            yield Unlabelled(label, frames)


def _measure_distance_in_gaps(markers: Array, shown: Mask, column: int, other: int) -> tuple[float, int, int]:
    """How far a trajectory, prolonged by a frame, misses another where that is lost or found again, m.

    Returns ``distance``: median over those frames; infinite where the two are seen side by side or never
    take turns. ``frames``: in which the trajectory is seen and the other is not.
    """
    here, there = shown[:, column], shown[:, other]
    if (here & there).sum() > OVERLAP * here.sum():
        return float("inf"), other, 0
    missed = []
    for step in (1, -1):  # the other is lost, then found again
        own, its = markers[::step, column], markers[::step, other]
        first = np.flatnonzero(there[::step][:-2] & here[::step][1:-1] & here[::step][2:]) + 1
        missed.append(np.linalg.norm(2.0 * own[first] - own[first + 1] - its[first - 1], axis=1))
    distances = np.concatenate(missed)
    if not len(distances):
        return float("inf"), other, 0
    return float(np.median(distances)), other, int((here & ~there).sum())


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
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
            f"{self.label} lies {here} from {self.neighbour}, and {there} in {self.other}, "
            f"while the others on that segment keep their distances within {left}: it was knocked, stuck on "
            "again, or is another"
        )


def find_moved_markers(trials: abc.Sequence[Trial], clusters: Clusters) -> abc.Iterator[MovedMarker]:
    """Markers that sit elsewhere in a recording than in more than half of the others.

    ``trials``: in m. Of two recordings that contradict each other the first tells. Labels that stand for each
    other are for :func:`find_exchanges`, and tell nothing here.
    """
    some = []
    for trial in trials:
        # Every so many frames of a recording
        step = max(1, trial.n_frames // _FRAMES)
        some.append(
            dataclasses.replace(
                trial, times=trial.times[::step], markers=trial.markers[::step], rate_hz=trial.rate_hz / step
            )
        )
    shapes = {trial.name: measure_shape([trial], clusters) for trial in some}
    reported: set[tuple[str, str]] = set()
    for trial in some:
        others = [name for name in shapes if name != trial.name]
        found = list(_find_moved(trial.name, shapes, others, clusters)) if others else []
        if found:
            usual = measure_shape((other for other in some if other is not trial), clusters)
            exchanged = {label for item in find_exchanges(trial, clusters, usual) for label in item.labels}
            found = [item for item in found if exchanged.isdisjoint((item.label, item.neighbour))]
        yield from (item for item in found if (item.label, item.other) not in reported)
        reported |= {(item.label, item.trial) for item in found}


def _find_moved(
    trial: str, shapes: abc.Mapping[str, Shape], others: abc.Sequence[str], clusters: Clusters
) -> abc.Iterator[MovedMarker]:
    for labels in clusters.values():
        measured = {label for pair in shapes[trial] for label in pair}
        for label in labels if measured.intersection(labels) else ():
            known = [_compare(label, labels, trial, other, shapes) for other in others]
            reported = [one for one in known if one is not None]
            moved = [one for one, alone in reported if alone]
            if 2 * len(moved) > len(reported):
                yield max(moved, key=lambda one: abs(one.here_m - one.there_m))


def _compare(
    label: str, labels: abc.Sequence[str], trial: str, other: str, shapes: abc.Mapping[str, Shape]
) -> tuple[MovedMarker, bool] | None:
    """The marker beside another recording, and whether it alone moved; None where that cannot be told."""
    here, there = shapes[trial], shapes[other]
    change = {pair: abs(here[pair] - there[pair]) for pair in here if pair in there and {*pair} <= {*labels}}
    own = {pair: size for pair, size in change.items() if label in pair}
    if len(own) < FEWEST_OF_SEGMENT - 1:
        return None
    worst = max(own, key=own.__getitem__)
    left = max(size for pair, size in change.items() if label not in pair)
    told_by = sum(size > EXPLAINED * own[worst] for size in own.values())
    alone = own[worst] > MOVED_M and left < EXPLAINED * own[worst] and told_by >= TOLD_BY
    (neighbour,) = {*worst} - {label}
    return MovedMarker(
        trial=trial,
        label=label,
        neighbour=neighbour,
        here_m=here[worst],
        there_m=there[worst],
        left_m=left,
        other=other,
    ), alone
