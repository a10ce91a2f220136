"""What recordings are understood to say: whose marker each label is, which way is up, and the unit."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject import rotations as subject_rotations
from scaling_service.capabilities.subject.axes import decide_axes, list_level_corners
from scaling_service.capabilities.subject.files import Files
from scaling_service.capabilities.subject.reading import with_stated_sizes
from scaling_service.core.errors import TrialUnusable, blame_file
from scaling_service.core.notes import Note
from scaling_service.model import labels
from scaling_service.model import subject as subjects
from scaling_service.model.trial import Trial
from scaling_service.recording import orientation as orientations
from scaling_service.recording.identity.identify import Identification
from scaling_service.recording.identity.tracking import ask_geometry, with_tracking_markers


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Understood:
    """The recordings under the model's names, in m and turned as the session is, not yet smoothed or filled.

    ``labels``: model marker to the labels that were taken for it, one unless recordings differ. ``clusters``:
    segment to the markers on it.
    """

    subject: subjects.Subject
    trials: abc.Mapping[Path, Trial]
    labels: abc.Mapping[str, tuple[str, ...]]
    clusters: abc.Mapping[str, tuple[str, ...]]
    axes: orientations.Orientation
    notes: tuple[Note, ...]


def understand(
    subject: subjects.Subject,
    files: Files,
    settings: Settings,
    *,
    facing: bool = False,
    standing: bool = False,
    who: Identification | None = None,
) -> Understood:
    """Whose marker each label is, which way is up and forward, and the unit; options as in :func:`load`."""
    model, recordings = files.model, files.recordings
    marked = {path: found for path, found in recordings.items() if found.labels}
    if not marked and files.vertical != 1:
        raise TrialUnusable(
            f"the model stands along {'xyz'[files.vertical]}; rotations are followed by those along y",
            field="model",
            remedy="Turn the model so that its gravity points along -y",
        )
    subject, of_sizes = with_stated_sizes(subject, recordings)
    of_tracking: tuple[Note, ...] = ()
    if marked:
        static = None if files.static is None else marked.get(files.static)
        movements = [found for path, found in marked.items() if path != files.static]
        ask = partial(ask_geometry, static, movements, subject.height_m) if who is None else lambda: who
        subject, of_tracking = with_tracking_markers(subject, model, movements or list(marked.values()), ask)
    wanted = list(dict.fromkeys([*model.marker_names, *subject.extra_markers, *subject.marker_map]))
    clusters = labels.sort_by_segment(model, subject)
    named = {}
    for path, found in marked.items():
        with blame_file(path, [path]):
            named[path] = labels.with_model_names(found.trial, wanted, subject, path)
    if marked:
        axes = decide_axes(
            {path: trial for path, (trial, _) in named.items()},
            {path: list_level_corners(found) for path, found in recordings.items()},
            model,
            settings,
            static=files.static,
            facing=facing,
            vertical=files.vertical,
        )
    else:
        first = next(iter(recordings.values()))
        axes = subject_rotations.decide_axes_of_rotations(first.trial, settings)
    axes = orientations.stand_along(axes, files.vertical) if standing else axes
    of_axes: tuple[Note, ...] = ()
    if not standing and files.vertical != 1:
        said = (
            f"the model stands along its {'xyz'[files.vertical]} axis, and motions are written with y up: "
            "lengths are its own, but in other programs these motions lie down; `scaling-service ik` on the "
            "written model follows in its own axes"
        )
        of_axes = (Note(code="lying", problem=said),)
    return Understood(
        subject=subject,
        trials={
            path: orientations.apply(axes, named[path][0])
            if path in named
            else orientations.turn_rotations(  # whose laboratory may be another
                subject_rotations.decide_axes_of_rotations(found.trial, settings), found.trial
            )
            for path, found in recordings.items()
        },
        labels={
            name: taken
            for name in wanted
            if (taken := tuple(dict.fromkeys(used[name] for _, used in named.values() if name in used)))
        },
        clusters=clusters,
        axes=axes,
        notes=(*files.notes, *of_sizes, *of_axes, *of_tracking),
    )
