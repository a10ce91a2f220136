"""The models before and after a search in space: played back by the page, and one moment in the report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.discovery.figures import AFTER_COLOUR, BEFORE_COLOUR
from scaling_service.capabilities.discovery.observations.tracked import TrackedTrial
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.playback import scene as playback
from scaling_service.capabilities.playback.document import SceneDocument
from scaling_service.capabilities.playback.drawing import MOST_FACES, Drawing, follow_person, place_bones
from scaling_service.model.trial import Bone
from scaling_service.numerics.multibody.laws import Array
from scaling_service.report.methods import spell_name
from scaling_service.report.scene import Body, Scene, coarsen

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
