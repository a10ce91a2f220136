"""The figures of a search's report, and the models before and after it in space, which the page plays back.

Colours: Okabe & Ito 2008, "Color Universal Design".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final, Literal

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.document import (
    DisagreementDocument,
    DiscoveryDocument,
    GapDocument,
    LevelDocument,
)
from scaling_service.capabilities.discovery.numbers import format_figures
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS, WrenchFit
from scaling_service.capabilities.discovery.ordinary.forces import expect_noise
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.discovery.text import describe_place
from scaling_service.capabilities.playback import scene as playback
from scaling_service.capabilities.playback.document import SceneDocument
from scaling_service.capabilities.playback.drawing import MOST_FACES, Drawing, follow_person, place_bones
from scaling_service.model.trial import Bone
from scaling_service.numerics.multibody.laws import Array
from scaling_service.report.figures import Figure, escape_plain, make_chart
from scaling_service.report.methods import INK, spell_name
from scaling_service.report.scene import Body, Scene, coarsen

BEFORE_COLOUR: Final = "#E69F00"
AFTER_COLOUR: Final = "#0072B2"
_FLOOR, _BOUND, _OTHER = "#9aa5b1", "#009E73", "#CC79A7"
_HEAT: Final = [[0.0, "#ffffff"], [0.25, "#fde3a7"], [0.6, "#e08214"], [1.0, "#7f2704"]]
"""From nothing to much: lightness falls all the way, so that it reads in grey, too."""

_MOST_TRIALS = 4
"""Chosen: heat maps of more recordings are scrolled past; those with the largest disagreement are shown."""

_COLUMNS = 160  # chosen: as many blocks of time as a page shows apart
_DARKEST = 98.0  # per cent of places and times that are lighter than the darkest (chosen)
_ROW_PX, _LEAST_PX = 15, 150
_TRIED = 10  # chosen: of what was not named, as many as stay readable
_HAIR = (
    0.01  # per cent: so short is the bar of what takes nothing off; without length it has no name beside it
)
_LONGEST_NAME = 60
_MM = 1e3

_HEAT_UNITS = (("mm", "distance from the model", "mm"), ("floors", "wrench over its noise floor", "times"))

Which = Literal["before", "after"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HeatMap:
    """How far model and recording are apart, place by place over time, before and after."""

    trial: str
    held_out: bool
    unit: str  # ``mm``, or ``floors`` for multiples of what noise leaves
    places: Sequence[str]
    times: Array  # (n,), s: middles of the blocks that were averaged
    before: Array  # before, after: (n_places, n); NaN where nothing was measured
    after: Array


def make_heat_maps(results: DiscoverResults) -> Iterator[HeatMap]:
    """Of the recordings with the largest disagreement: markers, and the wrench where there are forces."""
    ranking = [d.where for d in results.findings.disagreements]
    wrenches = {item.name: item for item in results.before.wrenches}
    corrected = {item.name: item for item in results.after.wrenches}
    for before, after in _choose_recordings(results):
        yield _of_markers(before, after, ranking)
        if before.name in wrenches and before.name in corrected:
            yield _of_wrench(wrenches[before.name], corrected[before.name])


def _choose_recordings(results: DiscoverResults) -> list[tuple[TrackedTrial, TrackedTrial]]:
    """A few recordings, at least one of each role, in the order in which they were given."""
    given = list(zip(results.before.tracked, results.after.tracked, strict=True))

    def take_typical(pair: tuple[TrackedTrial, TrackedTrial]) -> float:
        return float(np.nanmean((pair[0].residuals / pair[0].floor[:, None]) ** 2))

    pairs = sorted(given, key=take_typical, reverse=True)
    chosen = pairs[:_MOST_TRIALS]
    for role in ("fit", "held_out"):
        of_role = [pair for pair in pairs if pair[0].role == role]
        if of_role and not any(pair[0].role == role for pair in chosen):
            chosen = [*chosen[: _MOST_TRIALS - 1], of_role[0]]
    return [pair for pair in given if any(pair[0] is one for one, _ in chosen)]


def _of_markers(before: TrackedTrial, after: TrackedTrial, ranking: Sequence[str]) -> HeatMap:
    """Markers in the order of the ranking, so that all recordings have the same."""
    order = sorted(range(len(before.markers)), key=lambda k: ranking.index(before.markers[k]))
    away = [_MM * np.linalg.norm(item.residuals, axis=2)[:, order] for item in (before, after)]
    return _bin_rows(before, "mm", [before.markers[k] for k in order], away[0], away[1])


def _of_wrench(before: WrenchFit, after: WrenchFit) -> HeatMap:
    away = [
        np.where(item.usable[:, None], np.abs(item.residuals) / expect_noise(before.mass), np.nan)
        for item in (before, after)
    ]
    return _bin_rows(before, "floors", COMPONENTS, away[0], away[1])


def _bin_rows(
    item: TrackedTrial | WrenchFit, unit: str, places: Sequence[str], before: Array, after: Array
) -> HeatMap:
    times = item.times
    edges = np.linspace(0, len(times), min(_COLUMNS, len(times)) + 1).round().astype(np.intp)
    middles = np.array([times[a:b].mean() for a, b in pairwise(edges)])

    def compute_rms(values: Array) -> Array:
        known = np.isfinite(values)
        square = np.add.reduceat(np.where(known, values, 0.0) ** 2, edges[:-1], axis=0)
        count = np.add.reduceat(known.astype(float), edges[:-1], axis=0)
        mean = np.divide(square, count, out=np.full_like(square, np.nan), where=count > 0)
        return np.asarray(np.sqrt(mean).T)

    return HeatMap(
        trial=item.name,
        held_out=item.role == "held_out",
        unit=unit,
        places=places,
        times=middles,
        before=compute_rms(before),
        after=compute_rms(after),
    )


def draw_heat_maps(maps: Sequence[HeatMap], which: Which) -> Iterator[Figure]:
    """Places against time, one recording after the other; before and after have the same colours."""
    for unit, name, colours in _HEAT_UNITS:
        chosen = [m for m in maps if m.unit == unit]
        # what only a few places and times exceed is drawn darkest, so that these do not hide the rest
        values = np.concatenate([np.zeros(0), *(m.before[np.isfinite(m.before)] for m in chosen)])
        top = float(np.percentile(values, _DARKEST)) if len(values) else 0.0
        if top > 0.0:
            yield from (_draw_heat_map(heat, which, top, name, colours) for heat in chosen)


def _draw_heat_map(heat: HeatMap, which: Which, top: float, name: str, unit: str) -> Figure:
    values = heat.before if which == "before" else heat.after
    trace = go.Heatmap(
        x=np.round(heat.times, 3), y=[escape_plain(p) for p in heat.places],
        z=np.round(values, 2).astype(np.float32),
        zmin=0.0, zmax=top, colorscale=_HEAT, colorbar={"title": {"text": unit}, "thickness": 12, "len": 1.0},
        hovertemplate=f"%{{y}} at %{{x:.2f}} s: %{{z:.1f}} {unit}<extra></extra>",
    )  # fmt: skip
    figure = make_chart(
        [trace], x_title="time, s", hovermode="closest", yaxis_autorange="reversed",
        yaxis_tickfont={"size": 10}, yaxis_dtick=1, margin={"l": 70, "r": 8, "t": 6, "b": 38},
    )  # fmt: skip
    role = "held out" if heat.held_out else "used to fit"
    words = "before" if which == "before" else "with what was named"
    return Figure(
        figure,
        f"{heat.trial} ({role}), {words}: {name}; darkest {format_figures(top)} {unit} or more",
        f"{name} of {len(heat.places)} places over time in {heat.trial}, {words}; the most is "
        f"{np.nanmax(values) if np.isfinite(values).any() else 0.0:.1f} {unit}.",
        max(_LEAST_PX, 60 + _ROW_PX * len(heat.places)),
    )


def draw_ranking(places: Sequence[DisagreementDocument], title: str, unit: str) -> Figure:
    """What is left over at every place, with its floor."""
    order = sorted(places, key=lambda p: p.rms)
    names = [escape_plain(p.where) for p in order]
    traces = [
        go.Bar(
            x=[round(p.rms, 3) for p in order], y=names, orientation="h", marker={"color": BEFORE_COLOUR},
            name="left over", hovertemplate=f"%{{x:.1f}} {unit}",
        ),
        go.Scatter(
            x=[p.floor for p in order], y=names, mode="markers", name="noise floor",
            marker={"symbol": "line-ns", "size": 11, "line": {"width": 3, "color": INK}},
            hovertemplate=f"%{{x:.2f}} {unit}",
        ),
    ]  # fmt: skip
    figure = make_chart(
        traces, x_title=f"RMS of what is left over, {unit}", hovermode="y unified", bargap=0.25,
        showlegend=True, legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0},
        margin={"l": 70, "r": 10, "t": 28, "b": 40}, xaxis_rangemode="tozero",
    )  # fmt: skip
    worst = ", ".join(f"{p.where} {p.rms:.1f}" for p in order[::-1][:3])
    return Figure(
        figure,
        f"{title}: what is left over, and its noise floor (black marks)",
        f"Bars of all places, the largest first: {worst} {unit}.",
        max(_LEAST_PX, 90 + 18 * len(order)),
    )


def draw_gap(gaps: Mapping[str, GapDocument], field: str, name: str, unit: str) -> Figure:
    """Before, after, black-box bound and floor, of each role of recordings."""
    roles = [(role, level) for role, gap in gaps.items() if (level := getattr(gap, field)) is not None]
    x, levels = [role for role, _ in roles], [level for _, level in roles]
    bars = (
        ("before", "before", BEFORE_COLOUR),
        ("after", "after", AFTER_COLOUR),
        ("ceiling", "black-box bound", _BOUND),
        ("floor", "noise floor", _FLOOR),
    )
    traces = [
        go.Bar(
            x=x, y=[getattr(level, of) for level in levels], name=label, marker={"color": colour},
            error_y=_make_error_bar(levels) if of == "after" else None,
            text=[format_figures(getattr(level, of)) for level in levels],
            textposition="outside" if of == "floor" else "inside",
            insidetextanchor="start", textangle=0, textfont={"size": 10}, cliponaxis=False,
            hovertemplate="%{y:.3g}",
        )
        for of, label, colour in bars
    ]  # fmt: skip
    figure = make_chart(
        traces, y_title=f"RMS, {unit}", barmode="group", bargap=0.25, showlegend=True,
        legend={"orientation": "h", "y": -0.16, "x": 0}, margin={"l": 50, "r": 8, "t": 18, "b": 60},
        yaxis_rangemode="tozero",
    )  # fmt: skip
    said = "; ".join(
        f"{role}: {format_figures(v.before)} before, {format_figures(v.after)} after, "
        f"noise floor {format_figures(v.floor)}"
        for role, v in roles
    )
    return Figure(figure, f"{name.capitalize()}, {unit}", f"{said} {unit}.", 290)


def _make_error_bar(levels: Sequence[LevelDocument]) -> dict[str, object]:
    """The 95 % interval as lengths to either side."""
    above = [0.0 if v.high is None or v.after is None else max(v.high - v.after, 0.0) for v in levels]
    below = [0.0 if v.low is None or v.after is None else max(v.after - v.low, 0.0) for v in levels]
    return {"type": "data", "symmetric": False, "array": above, "arrayminus": below, "thickness": 1.5}


def draw_candidates(document: DiscoveryDocument) -> Figure:
    """Named effects and the best of what was not, by what each took off what did not fit it."""
    named = [(describe_place(e), e.evidence.gain_held_out or 0.0, True) for e in document.effects]
    tried = sorted(((describe_place(t), t.gain or 0.0, False) for t in document.tried), key=lambda c: -c[1])[
        :_TRIED
    ]
    bars = [*sorted(named, key=lambda c: -c[1]), *tried][::-1]
    short = [n if len(n) <= _LONGEST_NAME else f"{n[: _LONGEST_NAME - 1]}…" for n, _, _ in bars]
    trace = go.Bar(
        x=[max(_HAIR, round(100 * gain, 2)) for _, gain, _ in bars],
        y=[f"{len(bars) - k}." for k in range(len(bars))],
        text=[escape_plain(name) for name in short], textposition="auto", insidetextanchor="start",
        insidetextfont={"color": ["#ffffff" if found else INK for _, _, found in bars]},
        textangle=0, constraintext="none", cliponaxis=False, orientation="h",
        marker={"color": [AFTER_COLOUR if found else _OTHER for _, _, found in bars]},
        customdata=[f"{escape_plain(name)}: {format_figures(100 * gain)} %" for name, gain, _ in bars],
        hovertemplate="%{customdata}<extra></extra>",
    )  # fmt: skip
    figure = make_chart(
        [trace], x_title="share of the squared disagreement taken off what did not fit it, %",
        hovermode="closest", bargap=0.25, margin={"l": 34, "r": 12, "t": 6, "b": 40},
        yaxis_type="category",
    )  # fmt: skip
    listed = ", ".join(f"{name} {gain:.0%}" for name, gain, _ in named) or "none was named"
    return Figure(
        figure,
        "Candidates: named (blue), each when it was named; and the best of what was not (pink), at the end",
        f"Bars of {len(bars)} candidates: {listed}.",
        max(_LEAST_PX, 70 + 22 * len(bars)),
    )


BEFORE, AFTER = "as given", "with what was named"
"""Bodies of a search."""

_AROUND_S = 0.5  # chosen: of movement to either side of the frame of largest disagreement
_MOST_FRAMES = 41

Rows = NDArray[np.intp]


def write_discovery_scene(results: DiscoverResults, outputs: Path) -> SceneDocument:
    """Write the model as given, and with what was named, in all recordings, into a job's folder."""
    pairs = list(zip(results.before.tracked, results.after.tracked, strict=True))
    bones = _list_bones(results.prepared)
    bodies = [
        playback.Body(name, item.task.model, bones)
        for name, item in zip((BEFORE, AFTER), pairs[0], strict=True)
    ]
    recorded = [
        playback.Recorded(
            trial=before.trial,
            role="calibration" if before.role == "fit" else "evaluation",
            played=(_play_recording(BEFORE, before), _play_recording(AFTER, after)),
        )
        for before, after in pairs
    ]
    return playback.write_scene(results.prepared.subject.id, bodies, recorded, None, outputs)


def _list_bones(prepared: Prepared) -> dict[str, Bone]:
    """The person's bones where the model was scaled from images."""
    images = prepared.loaded.session.images
    if images is None or prepared.calibration is None:
        return {}
    coarse = {segment: coarsen(bone, MOST_FACES) for segment, bone in images.bones.items()}
    return place_bones(prepared.calibration, coarse)


def _play_recording(name: str, item: TrackedTrial) -> playback.Played:
    distances = np.linalg.norm(item.residuals, axis=2)
    model = item.task.model
    return playback.Played(
        body=name,
        model=model,
        q=item.q,
        markers=item.markers,
        distances=distances,
        estimated=frozenset(model.coordinate_names),
    )


def draw_largest_change(results: DiscoverResults) -> Scene | None:
    """Both models around the frame in which they differ most; None where no marker was seen."""
    before, after = max(
        zip(results.before.tracked, results.after.tracked, strict=True),
        key=lambda pair: _find_largest(*pair)[0],
    )
    middle = _find_largest(before, after)[1]
    rows = _select_around(before.trial.times, middle)
    labels = tuple(m for m in before.markers if m in after.markers)
    measured = after.trial.select(labels).markers[rows]
    if not np.isfinite(measured).any():
        return None
    role = "held out" if before.role == "held_out" else "used to fit"
    return follow_person(
        Scene(
            caption=f"{before.name} ({role}) around {before.trial.times[middle]:.2f} s, where the two "
            "differ most",
            description=f"The model {BEFORE} and {AFTER}, with measured markers in {before.name}, turned by "
            "dragging.",
            times=before.trial.times[rows],
            labels=labels,
            measured=measured,
            bodies=[
                _make_body(BEFORE, BEFORE_COLOUR, before, rows, labels),
                _make_body(AFTER, AFTER_COLOUR, after, rows, labels),
            ],
        )
    )


def _find_largest(before: TrackedTrial, after: TrackedTrial) -> tuple[float, int]:
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


def _select_around(times: Array, middle: int) -> Rows:
    """Frames to either side, as many on both so that the middle one is seen first."""
    near = np.flatnonzero(np.abs(times - times[middle]) <= _AROUND_S)
    reach = int(min(middle - near[0], near[-1] - middle))
    half = min(reach, _MOST_FRAMES // 2)
    step = reach // half if half else 1
    return np.asarray(middle + step * np.arange(-half, half + 1), dtype=np.intp)


def _make_body(name: str, colour: str, item: TrackedTrial, rows: Rows, labels: tuple[str, ...]) -> Body:
    drawing = Drawing(item.task.model)
    for label in labels:
        drawing.add_marker(label)
    return Body(
        name=name,
        colour=colour,
        points=drawing.positions(item.q[rows]),
        centres=[(k, spell_name(centre)) for centre, k in drawing.centres.items()],
        sticks=drawing.sticks,
        axes=drawing.axes,
        markers=[(k, label, labels.index(label)) for label, k in drawing.markers.items()],
    )
