"""A session that is ready to compute with: recordings smoothed and filled, and all else in its files."""

from __future__ import annotations

from collections import abc
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path

from scaling_service.capabilities.subject.files import Files
from scaling_service.capabilities.subject.images import place_images
from scaling_service.capabilities.subject.understanding import Understood
from scaling_service.core.errors import TrialUnusable, blame_file
from scaling_service.core.notes import Note
from scaling_service.model import builtin, labels
from scaling_service.model import subject as subjects
from scaling_service.model.forces import PlateRecording
from scaling_service.model.trial import Trial
from scaling_service.recording.orientation import Orientation
from scaling_service.recording.pipeline import clean
from scaling_service.recording.scale_setup import require_measurements
from scaling_service.recording.settings import ProcessingSettings


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Loaded:
    """A session, and how its labels and axes were understood.

    ``markers_used``: model marker to the labels that were taken for it, one unless trials differ.
    ``plates``: recording to its own force plates, or why they cannot be used.
    """

    session: subjects.Session
    markers_used: abc.Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    axes: str = ""  # which laboratory axes were taken for up and forward
    orientation: Orientation | None = None  # the same as a rotation, for forces
    plates: abc.Mapping[Path, PlateRecording | TrialUnusable] = field(default_factory=dict)
    file: Path | None = None  # the subject file, where there is one

    def blame_files(self) -> AbstractContextManager[None]:
        """Let errors raised inside name the subject file, or the recording whose stem they name."""
        return blame_file(self.file, subjects.list_recordings(self.session.subject))


def prepare(
    understood: Understood, told: abc.Iterable[Note], files: Files, settings: ProcessingSettings
) -> Loaded:
    """Smooth and fill the recordings, lock what they do not show, and add what else the files hold.

    ``told``: what there is to tell of the recordings.
    """
    subject, model = understood.subject, files.model
    ready = apply_to_each(
        lambda trial: clean(trial, understood.clusters, settings) if trial.labels else trial,
        understood.trials,
    )
    setup, of_setup = files.scale_setup, tuple[Note, ...]()
    standing = next(iter(p for p in (subject.static, *subject.calibration) if p is not None), None)
    if setup is not None and subject.scale_setup is not None and standing is not None:
        of_setup = tuple(require_measurements(setup, model, ready[standing], subject.scale_setup))
    if setup is not None and setup.placement is not None:  # its marker placer leaves these alone
        fixed = frozenset(marker.name for marker in model.markers if marker.anatomical)
        setup = replace(setup, placement=replace(setup.placement, fixed=fixed))
    followed = list(dict.fromkeys([*model.marker_names, *subject.extra_markers]))
    images = None
    if files.images is not None:
        images = place_images(files.images, model, followed, subject.marker_map)
    placed = labels.list_placed(model, subject, understood.trials.values())
    model, of_freedoms = builtin.lock_unmarked(model, placed)
    session = subjects.Session(
        subject=subject,
        model=model,
        static=None if subject.static is None else ready[subject.static],
        calibration=tuple(ready[path] for path in subject.calibration),
        evaluation=tuple(ready[path] for path in subject.evaluation),
        scale_setup=setup,
        notes=(
            *understood.notes,
            *of_freedoms,
            *of_setup,
            *(() if files.images is None else files.images.notes),
            *told,
        ),
        images=images,
    )
    return Loaded(
        session=session,
        markers_used=understood.labels,
        axes=understood.axes.description,
        orientation=understood.axes,
        plates={path: found.plates for path, found in files.recordings.items() if found.plates is not None},
    )


def apply_to_each(step: abc.Callable[[Trial], Trial], trials: abc.Mapping[Path, Trial]) -> dict[Path, Trial]:
    """One step on every recording; errors name the file."""
    made = {}
    for path, trial in trials.items():
        with blame_file(path, [path]):
            made[path] = step(trial)
    return made
