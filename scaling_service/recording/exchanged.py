"""Labels that look exchanged: outer and inner ones of a joint, and markers of one segment.

Nothing is corrected: which of two labels a marker deserves is for those to say who saw the person.
"""

from __future__ import annotations

import dataclasses
from collections import abc
from itertools import combinations, pairwise, permutations
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.arrays import Array
from scaling_service.model.subject import Session
from scaling_service.model.trial import Relabelling, Repair, Trial
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.signals.filters import find_runs

LEG_PAIRS = (("LFE", "MFE"), ("LM", "MM"))
"""Lateral and medial landmarks that face outwards in every posture: thigh and shank turn less than a right
angle about their length against the pelvis (circumduction in real recordings: 52 deg at the ankle)."""

FOOT_PAIRS = (("MT5", "MT1"),)
"""The same of feet, which turn farther, so that their direction is told and never beyond doubt."""

ARM_PAIRS = (("ELB", "MEL"),)
"""The upper arm turns further than that (142 deg in a real recording, arms held off the hips), so
that only a jump tells anything about them."""

_LEGS = {lateral for lateral, _ in LEG_PAIRS}

SHORTEST_S = 0.1  # a stretch shorter than this is a flicker that smoothing and robust fits survive (chosen)

ABRUPT = 0.5
"""Share of the distance between two markers by which the line between them must change from one frame to the
next to count as a jump (chosen: exchanged labels give 2, and 100 frames per second of a fast kick 0.2)."""

CLEAR = 0.5
"""Cosine beyond which a direction counts as opposite throughout a trial (chosen: within 60 deg of it)."""

_PELVIS = (("RASIS", "LASIS"), ("RPSIS", "LPSIS"))
_Places = abc.Mapping[str, tuple[str, Array]]  # landmark to its label and its trajectory, (n_frames, 3)

CHANGED_M = 0.025
"""Chosen: a distance within a segment that differs by more is no skin alone (soft tissue of a thigh in deep
squats reaches 40 mm, so a better assignment of the labels must explain it, too)."""

EXPLAINED = 0.4
"""Chosen: share of the difference that labels put right may leave; those of real recordings leave 0.2."""

JUMP_M = 0.015
"""Chosen: a distance within a segment that changes by more from one frame to the next is a change of labels
(1.5 m/s at 100 frames per second; skin in running stays below 1)."""

MOST_COMPARED = 40
"""Chosen: labels of one segment whose distances are compared. Densely marked thighs have up to thirty."""

_EVERY_ORDER = 7  # markers of a segment whose every order is tried (5040); of more, exchanges of two


def find_exchanged_labels(trial: Trial, roles: abc.Mapping[str, str]) -> abc.Iterator[tuple[Exchange, bool]]:
    """Where the labels of an outer and an inner landmark look exchanged, and whether throughout.

    ``trial``: in any axes and unit; before gaps are filled and positions smoothed, which blurs jumps.
    ``roles``: label to landmark (``RLFE``, ``RMFE`` …). Nothing is corrected.

    The line from the medial to the lateral landmark is followed from frame to frame. Where it jumps to
    the opposite direction the labels changed places; the stretches in which it points inwards, seen along
    the pelvis, are the wrong ones. Of arms, and where nothing tells the body's right from its left, the
    shorter stretches are taken for the wrong ones.
    """
    for labels, wrong in find_turned_limbs(trial, roles):
        for first, stop in find_runs(wrong).tolist():
            if wrong.all() or stop - first >= SHORTEST_S * trial.rate_hz:
                start, end = float(trial.times[first]), float(trial.times[stop - 1])
                yield Exchange(labels=labels, true=labels[::-1], start_s=start, end_s=end), bool(wrong.all())


def find_turned_limbs(
    trial: Trial, roles: abc.Mapping[str, str]
) -> abc.Iterator[tuple[tuple[str, str], NDArray[np.bool_]]]:
    """Labels of a lateral and a medial landmark, and the frames in which they look exchanged, (n_frames,)."""
    places = {roles[label]: (label, trial.position(label)) for label in trial.labels if label in roles}
    pairs = [
        (f"{side}{lateral}", f"{side}{medial}")
        for side in "RL"
        for lateral, medial in (*LEG_PAIRS, *FOOT_PAIRS, *ARM_PAIRS)
        if f"{side}{lateral}" in places and f"{side}{medial}" in places
    ]
    lines = {}
    for lateral, medial in pairs:
        # From the inner to the outer landmark of a right limb, the other way of a left one
        line: Array = places[lateral][1] - places[medial][1]
        lines[lateral] = line if lateral[0] == "R" else -line
    for lateral, medial in pairs:
        others = [line for name, line in lines.items() if name != lateral and name[1:] in _LEGS]
        facing = lateral[1:] in _LEGS or (lateral[1:], medial[1:]) in FOOT_PAIRS
        rightwards = _find_rightwards(places, others) if facing else None
        yield ((places[lateral][0], places[medial][0]), _find_wrong(lines[lateral], rightwards, trial.times))


def _normalise(vectors: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        directions: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return directions


def _find_rightwards(places: _Places, lines: abc.Sequence[Array]) -> Array | None:
    """The body's direction to the right in every frame, NaN where it is not known."""
    choices = [places[r][1] - places[left][1] for r, left in _PELVIS if r in places and left in places]
    if len(lines) > 1:  # one alone may be the wrong one
        mean = np.mean([_normalise(line) for line in lines], axis=0)
        agreed = np.linalg.norm(mean, axis=1, keepdims=True) > CLEAR
        choices.append(np.where(agreed, mean, np.nan))
    if not choices:
        return None
    found = choices[0].copy()
    for choice in choices[1:]:
        found = np.where(np.isfinite(found), found, choice)
    return _normalise(found)


def _find_wrong(line: Array, rightwards: Array | None, times: Array) -> NDArray[np.bool_]:
    """The frames in which a line that should point to the right looks exchanged, (n_frames,)."""
    wrong = np.zeros(len(line), dtype=bool)
    rows = np.flatnonzero(np.isfinite(line).all(axis=1) & (np.linalg.norm(line, axis=1) > 0.0))
    if not len(rows):
        return wrong
    seen = line[rows]
    outwards = np.full(len(rows), np.nan)
    if rightwards is not None:
        outwards = np.einsum("fi,fi->f", _normalise(seen), rightwards[rows])
    # Whether the line turns round between each seen frame and the next one seen, (n_seen - 1,)
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=1)
    turns = np.einsum("fi,fi->f", seen[1:], seen[:-1]) < 0.0
    abrupt = steps > ABRUPT * float(np.median(np.linalg.norm(seen, axis=1)))
    # Over a longer time unseen a person may turn round; then the change against the pelvis tells.
    soon = np.diff(times[rows]) <= SHORTEST_S
    jumps = np.where(soon, turns & abrupt, outwards[1:] * outwards[:-1] < 0.0)
    turned = np.cumsum(np.concatenate(([False], jumps))) % 2 == 1
    known = [outwards[(turned == part) & np.isfinite(outwards)] for part in (False, True)]
    inside = [float(np.median(values)) if len(values) else float("nan") for values in known]
    if not turned.any():
        guilty = np.full(len(rows), inside[0] < -CLEAR)
    elif np.isfinite(inside).all():
        worse = turned if inside[1] < inside[0] else ~turned
        guilty = worse & (min(inside) < 0.0 < max(inside))
    else:
        guilty = turned if turned.sum() <= len(turned) / 2 else ~turned
    # A frame in which one of them is not seen goes with the frame before it.
    wrong[rows[0] :] = guilty[np.searchsorted(rows, np.arange(rows[0], len(line)), side="right") - 1]
    wrong[rows[-1] + 1 :] = False
    return wrong


Clusters = abc.Mapping[str, abc.Sequence[str]]  # segment to labels on it

Shape = abc.Mapping[tuple[str, str], float]
"""Two labels of one segment, in alphabetical order, to their usual distance, m."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """Labels of one segment that stand for each other for a while.

    ``true``: what the markers labelled so are, in the same order. ``difference_m``, ``left_m``: how far
    distances are from the usual ones as labelled, and with the labels put right.
    """

    labels: tuple[str, ...]  # those that are wrong
    true: tuple[str, ...]
    start_s: float
    end_s: float
    difference_m: float = 0.0
    left_m: float = 0.0


def measure_shape(trials: abc.Iterable[Trial], clusters: Clusters) -> dict[tuple[str, str], float]:
    """The usual distance of every two markers of a segment, over the recordings that show both.

    ``trials``: in m; of each, its median counts once, however long it is.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for trial in trials:
        for labels in clusters.values():
            for pair in combinations(_list_compared(trial, labels), 2):
                distance = _measure_distance(trial, *pair)
                known = distance[np.isfinite(distance)]
                if len(known):
                    found.setdefault(pair, []).append(float(np.median(known)))
    return {pair: float(np.median(values)) for pair, values in found.items()}


def _list_compared(trial: Trial, labels: abc.Sequence[str]) -> list[str]:
    return sorted(set(trial.labels).intersection(labels))[:MOST_COMPARED]


def _measure_distance(trial: Trial, one: str, other: str) -> Array:
    distance: Array = np.linalg.norm(trial.position(one) - trial.position(other), axis=1)
    return distance


def find_exchanges(trial: Trial, clusters: Clusters, usual: Shape) -> abc.Iterator[Exchange]:
    """Where labels of one segment would fit the usual shape far better in another order.

    ``trial``: in m, before gaps are filled and positions smoothed. ``usual``: of other recordings,
    :func:`measure_shape`.
    """
    for labels in clusters.values():
        names = _list_compared(trial, labels)
        pairs = [pair for pair in combinations(names, 2) if pair in usual]
        if len(pairs) < 2:
            continue
        measured = np.stack([_measure_distance(trial, *pair) for pair in pairs], axis=1)
        away = np.abs(measured - [usual[pair] for pair in pairs])
        changed = np.nan_to_num(away).max(axis=1) > CHANGED_M
        # Blocks in a row with the same labels wrong as one.
        found = (
            Exchange(
                labels=tuple(a for a, b in zip(names, found[0], strict=True) if a != b),
                true=tuple(b for a, b in zip(names, found[0], strict=True) if a != b),
                start_s=float(trial.times[start]),
                end_s=float(trial.times[stop - 1]),
                difference_m=found[1],
                left_m=found[2],
            )
            for start, stop in _split_blocks(changed, measured)
            if stop - start >= SHORTEST_S * trial.rate_hz
            if (found := _find_better_order(names, pairs, measured[start:stop], usual)) is not None
        )
        last: Exchange | None = None
        for item in found:
            alike = last is not None and (last.labels, last.true) == (item.labels, item.true)
            if last is not None and alike and item.start_s - last.end_s < SHORTEST_S:
                last = dataclasses.replace(
                    last,
                    end_s=item.end_s,
                    difference_m=max(last.difference_m, item.difference_m),
                    left_m=max(last.left_m, item.left_m),
                )
                continue
            if last is not None:
                yield last
            last = item
        if last is not None:
            yield last


def without_exchanges(session: Session) -> tuple[Session, tuple[str, ...]]:
    """The session without labels while these stand for each other, and a sentence for each time they do.

    Of its movements, in m, before gaps are filled; each is held against the others, a single one against
    itself.
    """
    trials, kept, said = session.dynamic, dict[str, Trial](), list[str]()
    clusters: dict[str, list[str]] = {}
    for marker in session.model.markers:
        clusters.setdefault(marker.segment, []).append(marker.name)
    for trial in trials:
        usual = measure_shape([other for other in trials if other is not trial] or [trial], clusters)
        markers = trial.markers.copy()
        for wrong in find_exchanges(trial, clusters, usual):
            inside = (trial.times >= wrong.start_s) & (trial.times <= wrong.end_s)
            columns = np.array([trial.index(label) for label in wrong.labels])
            markers[np.ix_(inside, columns)] = np.nan
            span = f"from {wrong.start_s:.2f} to {wrong.end_s:.2f} s"
            said.append(f"{trial.name}: the labels {' and '.join(wrong.labels)} look exchanged {span}")
        kept[trial.name] = dataclasses.replace(trial, markers=markers)
    if not said:
        return session, ()
    calibration, evaluation = (
        tuple(kept[trial.name] for trial in some) for some in (session.calibration, session.evaluation)
    )
    return dataclasses.replace(session, calibration=calibration, evaluation=evaluation), tuple(said)


_Kind = TypeVar("_Kind", bound=Trial)


def relabel(trial: _Kind, corrections: abc.Iterable[Relabelling]) -> _Kind:
    """The trial with labels put right as a person decided, each change among its repairs.

    While it lasts, a marker goes under its right label, in place of what stands there while it is seen; a
    label that is given away and not taken, or left out, has a gap. A right label that the trial lacks is
    added.

    Raises MarkerMissing: the trial has no such label.
    """
    for item in corrections:
        half = 0.5 / trial.rate_hz  # times in documents are rounded
        inside = (trial.times >= item.start_s - half) & (trial.times <= item.end_s + half)
        taken = {trial.index(wrong): right for wrong, right in item.labels.items()}
        new = [right for right in taken.values() if right is not None and right not in trial.labels]
        labels = (*trial.labels, *new)
        markers = np.full((trial.n_frames, len(labels), 3), np.nan)
        markers[:, : len(trial.labels)] = trial.markers
        markers[np.ix_(inside, np.array(list(taken)))] = np.nan
        for wrong, right in taken.items():
            if right is not None:
                seen = inside & find_seen(trial.markers[:, wrong])
                markers[seen, labels.index(right)] = trial.markers[seen, wrong]
        span = f"from {item.start_s:.2f} to {item.end_s:.2f} s, as the subject file says"
        made = Repair(
            "labels_exchanged" if set(item.labels) == set(item.labels.values()) else "labels_changed",
            ", ".join(item.labels),
            f"{describe_relabelling(item)} {span}",
            frames=int(inside.sum()),
        )
        trial = dataclasses.replace(trial, labels=labels, markers=markers, repairs=(*trial.repairs, made))
    return trial


def describe_relabelling(item: Relabelling) -> str:
    """What is done to the labels, without its time.

    Examples
    --------
    >>> describe_relabelling(Relabelling({"RKNE": None, "*12": "RANK"}, 0.0, 1.0))
    'RKNE left out, *12 taken for RANK'
    """
    if set(item.labels) == set(item.labels.values()):
        return f"{' and '.join(item.labels)} exchanged"
    return ", ".join(
        f"{wrong} left out" if right is None else f"{wrong} taken for {right}"
        for wrong, right in item.labels.items()
    )


def _split_blocks(changed: NDArray[np.bool_], measured: Array) -> abc.Iterator[tuple[int, int]]:
    """Runs of changed frames, cut where a distance jumps."""
    with np.errstate(invalid="ignore"):
        jumps = np.flatnonzero(np.nanmax(np.abs(np.diff(measured, axis=0)), axis=1, initial=0.0) > JUMP_M) + 1
    for start, stop in find_runs(changed):
        cuts = [int(start), *(int(j) for j in jumps if start < j < stop), int(stop)]
        yield from pairwise(cuts)


def _find_better_order(
    names: abc.Sequence[str], pairs: abc.Sequence[tuple[str, str]], measured: Array, usual: Shape
) -> tuple[tuple[str, ...], float, float] | None:
    """The order of labels that fits a block best, with the largest difference before and after."""
    known = np.asarray(np.isfinite(measured).any(axis=0))
    kept = [pair for pair, is_known in zip(pairs, known, strict=True) if is_known]
    if len(kept) < 2:
        return None
    typical = dict(zip(kept, np.nanmedian(measured[:, known], axis=0).tolist(), strict=True))
    seen = sorted({name for pair in kept for name in pair})
    misfit = {
        order: _measure_misfit(dict(zip(seen, order, strict=True)), typical, usual)
        for order in _list_orders(seen)
    }
    before = misfit[tuple(seen)]
    order = min(misfit, key=lambda o: misfit[o])
    if before < CHANGED_M or misfit[order] > EXPLAINED * before:
        return None
    renamed = dict(zip(seen, order, strict=True))
    return tuple(renamed.get(name, name) for name in names), before, misfit[order]


def _list_orders(names: abc.Sequence[str]) -> abc.Iterator[tuple[str, ...]]:
    if len(names) <= _EVERY_ORDER:
        yield from permutations(names)
        return
    yield tuple(names)
    for a, b in combinations(range(len(names)), 2):
        order = list(names)
        order[a], order[b] = order[b], order[a]
        yield tuple(order)


def _measure_misfit(true: abc.Mapping[str, str], typical: Shape, usual: Shape) -> float:
    """The largest difference of a distance from the usual one, m; infinite where one is not known."""
    worst = 0.0
    for (a, b), distance in typical.items():
        x, y = sorted((true[a], true[b]))
        if (x, y) not in usual:
            return float("inf")
        worst = max(worst, abs(distance - usual[x, y]))
    return worst
