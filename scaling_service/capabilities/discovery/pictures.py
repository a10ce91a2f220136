"""What the report of a search shows: disagreement over time, the model without and with what was named."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.document import DiscoveryDocument
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS, WrenchFit
from scaling_service.capabilities.discovery.report.data import DiscoveryData, HeatMap
from scaling_service.capabilities.discovery.report.style import AFTER, BEFORE
from scaling_service.capabilities.discovery.run import DiscoverResults
from scaling_service.capabilities.discovery.words import known_kinds, meaning
from scaling_service.capabilities.playback.overlay import Drawing, centred
from scaling_service.numerics.multibody.laws import Array
from scaling_service.report.methods import words
from scaling_service.report.scene import Body, Scene

MOST_TRIALS = 4
"""Chosen: heat maps of more recordings are scrolled past; those with the largest disagreement are shown."""

_COLUMNS = 160
"""Chosen: as many stretches of time as a page shows apart."""

_AROUND_S = 0.5
"""Chosen: of movement to either side of the frame of largest disagreement."""

_MOST_FRAMES = 41
_MM = 1e3

Rows = NDArray[np.intp]


def pictures(results: DiscoverResults, document: DiscoveryDocument) -> DiscoveryData:
    """What the report shows.

    Parameters
    ----------
    results : DiscoverResults
    document : DiscoveryDocument
        What is written as ``discovery.json``; the report's tables take their numbers from it.
    """
    return DiscoveryData(
        document,
        {kind: meaning(kind) for kind in known_kinds()},
        tuple(_maps(results)),
        scene(results) if document.effects else None,
    )


def _pairs(results: DiscoverResults) -> list[tuple[TrackedTrial, TrackedTrial]]:
    """Every recording as followed before and after, the largest disagreement first."""
    both = list(zip(results.before.tracked, results.after.tracked, strict=True))
    return sorted(both, key=lambda pair: -_typical(pair[0]))


def _typical(item: TrackedTrial) -> float:
    return float(np.nanmean((item.residuals / item.floor[:, None]) ** 2))


def _shown(results: DiscoverResults) -> list[tuple[TrackedTrial, TrackedTrial]]:
    """A few recordings, at least one of each role, in the order in which they were given."""
    pairs = _pairs(results)
    chosen = pairs[:MOST_TRIALS]
    for role in ("fit", "held_out"):
        of_role = [pair for pair in pairs if pair[0].role == role]
        if of_role and not any(pair[0].role == role for pair in chosen):
            chosen = [*chosen[: MOST_TRIALS - 1], of_role[0]]
    order = [item.name for item in results.before.tracked]
    return sorted(chosen, key=lambda pair: order.index(pair[0].name))


def _maps(results: DiscoverResults) -> Iterator[HeatMap]:
    ranking = [d.where for d in results.findings.disagreements]
    weighed = {item.name: item for item in results.before.wrenches}
    after = {item.name: item for item in results.after.wrenches}
    for before, now in _shown(results):
        yield _of_markers(before, now, ranking)
        if before.name in weighed and before.name in after:
            yield _of_wrench(weighed[before.name], after[before.name])


def _of_markers(before: TrackedTrial, after: TrackedTrial, ranking: Sequence[str]) -> HeatMap:
    """Markers in the order of the ranking, so that all recordings have the same."""
    away = [_MM * np.linalg.norm(item.residuals, axis=2) for item in (before, after)]
    order = sorted(range(len(before.markers)), key=lambda k: ranking.index(before.markers[k]))
    held_out = before.role == "held_out"
    return _binned(
        before.name, held_out, "mm", [before.markers[k] for k in order], before.trial.times,
        away[0][:, order], away[1][:, order],
    )  # fmt: skip


def _of_wrench(before: WrenchFit, after: WrenchFit) -> HeatMap:
    away = [
        np.where(item.usable[:, None], np.abs(item.residuals) / before.floor, np.nan)
        for item in (before, after)
    ]
    return _binned(
        before.name, before.role == "held_out", "floors", COMPONENTS, before.times, away[0], away[1]
    )


def _binned(
    trial: str,
    held_out: bool,
    unit: str,
    places: tuple[str, ...] | list[str],
    times: Array,
    before: Array,
    after: Array,
) -> HeatMap:
    edges = np.linspace(0, len(times), min(_COLUMNS, len(times)) + 1).round().astype(np.intp)
    middles = np.array([times[a:b].mean() for a, b in pairwise(edges)])
    return HeatMap(trial, held_out, unit, tuple(places), middles, _rms(before, edges), _rms(after, edges))


def _rms(values: Array, edges: Rows) -> Array:
    """RMS over stretches of frames, (n_places, n_stretches); NaN where nothing is known."""
    known = np.isfinite(values)
    square = np.add.reduceat(np.where(known, values, 0.0) ** 2, edges[:-1], axis=0)
    count = np.add.reduceat(known.astype(float), edges[:-1], axis=0)
    mean = np.divide(square, count, out=np.full_like(square, np.nan), where=count > 0)
    return np.asarray(np.sqrt(mean).T)


def scene(results: DiscoverResults) -> Scene | None:
    """The model without and with what was named, around the frame in which they differ most.

    Returns
    -------
    Scene or None
        None where no marker was seen.
    """
    before, after = max(
        zip(results.before.tracked, results.after.tracked, strict=True), key=lambda pair: _largest(*pair)[0]
    )
    middle = _largest(before, after)[1]
    rows = _around(before.trial.times, middle)
    labels = tuple(m for m in before.markers if m in after.markers)
    measured = after.trial.selected(labels).markers[rows]
    if not np.isfinite(measured).any():
        return None
    bodies = [
        _body("as given", BEFORE, before, rows, labels),
        _body("with what was named", AFTER, after, rows, labels),
    ]
    role = "held out" if before.role == "held_out" else "used to fit"
    return centred(
        Scene(
            f"{before.name} ({role}) around {before.trial.times[middle]:.2f} s, where the two differ most",
            f"The model as given and with what was named, with measured markers in {before.name}, turned by "
            "dragging.",
            before.trial.times[rows],
            labels,
            measured,
            bodies,
        )
    )


def _largest(before: TrackedTrial, after: TrackedTrial) -> tuple[float, int]:
    """By how much the mean square of a frame's distances falls at most, m2, and in which frame.

    Both are held against the corrected recording, so that it is the models that differ. Not at the very ends,
    where nothing could be shown to one side.
    """
    shared = [m for m in before.markers if m in after.markers]
    columns = [[item.markers.index(m) for m in shared] for item in (before, after)]
    model = (before.task.measured - before.residuals)[:, columns[0]]
    left = after.task.measured[:, columns[1]] - model, after.residuals[:, columns[1]]
    squares = [np.square(each).sum(axis=2) for each in left]
    seen = [np.isfinite(s).sum(axis=1) for s in squares]
    means = [np.nansum(s, axis=1) / np.maximum(n, 1) for s, n in zip(squares, seen, strict=True)]
    gain = np.where((seen[0] > 0) & (seen[1] > 0), means[0] - means[1], -np.inf)
    margin = min(_MOST_FRAMES // 2, len(gain) // 4)
    frame = margin + int(np.argmax(gain[margin : len(gain) - margin]))
    return float(gain[frame]), frame


def _around(times: Array, middle: int) -> Rows:
    """Frames to either side, as many on both so that the middle one is seen first."""
    near = np.flatnonzero(np.abs(times - times[middle]) <= _AROUND_S)
    reach = int(min(middle - near[0], near[-1] - middle))
    half = min(reach, _MOST_FRAMES // 2)
    step = reach // half if half else 1
    return np.asarray(middle + step * np.arange(-half, half + 1), dtype=np.intp)


def _body(name: str, colour: str, item: TrackedTrial, rows: Rows, labels: tuple[str, ...]) -> Body:
    drawing = Drawing(item.task.model)
    for label in labels:
        drawing.add_marker(label)
    return Body(
        name,
        colour,
        drawing.positions(item.q[rows]),
        centres=[(k, words(centre)) for centre, k in drawing.centres.items()],
        sticks=drawing.sticks,
        axes=drawing.axes,
        markers=[(k, label, labels.index(label)) for label, k in drawing.markers.items()],
    )
