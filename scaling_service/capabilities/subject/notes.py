"""What the recordings give cause to tell before anything is computed from them."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence

import numpy as np

from scaling_service.core.text import few
from scaling_service.model.anatomy.markers import canonical
from scaling_service.model.body import BodyModel
from scaling_service.model.subject import Subject
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.masks import ever, seen
from scaling_service.recording.exchanged import exchanged

_TOLD = ("stray", "impossible_position", "cut_row")
"""Repairs that a person should know of without opening the results."""

_STANDS_IN: Mapping[str, tuple[str, ...]] = {
    "RPSIS": ("SACR", "LPSIS"),
    "LPSIS": ("SACR", "RPSIS"),
    **{
        f"{side}{inner}": (f"{side}{outer}",)
        for side in "RL"
        for inner, outer in (("MFE", "LFE"), ("MM", "LM"))
    },
}
"""Landmark, and those from which scaling constructs what it needs of it, the best first."""

_FRAME_COUNTS = ("NumFrames", "frames")
"""Where a header's count of frames differs from what the file holds, it may be the half of a recording."""


def notes(model: BodyModel, subject: Subject, trials: Sequence[Trial]) -> Iterator[str]:
    """One plain sentence for each thing.

    ``trials``: with the model's names, before gaps are filled and positions smoothed.
    """
    shown = {trial.name: _shown(trial) for trial in trials}
    if subject.calibration and not subject.evaluation:
        yield (
            "there is no evaluation trial: nothing says how well the models follow recordings that were "
            "not used to fit"
        )
    yield from _unseen(model, subject, set().union(*shown.values()), trials)
    for trial in trials:
        yield from _repaired(trial)
        yield from exchanged(trial, {label: role for label in trial.labels if (role := canonical(label))})


def _shown(trial: Trial) -> set[str]:
    """The labels that are seen in some frame."""
    return {trial.labels[k] for k in np.flatnonzero(ever(seen(trial.markers)))}


def _unseen(model: BodyModel, subject: Subject, shown: set[str], trials: Sequence[Trial]) -> Iterator[str]:
    followed = [m.name for m in model.markers if m.weight > 0.0]
    missing = [name for name in followed if name not in shown]
    landmarks = {canonical(name) for name in shown}
    computed = [m.name for m in model.markers if m.weight == 0.0 and m.name in shown]
    if computed:
        yield (
            f"{few(computed)} are points that software computed from markers: they are not followed; "
            f"map them under `markers:` to use them"
        )
    replaced = {name: found for name in missing if (found := _stand_in(name, landmarks)) is not None}
    if replaced:
        stand_ins = list(dict.fromkeys(replaced.values()))
        yield f"{few(list(replaced))} not recorded: {few(stand_ins)} and sizes stand in for them"
    missing = [name for name in missing if name not in replaced]
    if missing:
        yield f"no recording shows {', '.join(missing)} of the model: not used"
    for label in subject.extra_markers:
        if label not in shown:
            yield f"extra marker '{label}' is in no recording: it is left out"
    for trial in trials:
        here = _shown(trial)
        empty = [n for n in (*followed, *subject.extra_markers) if n in trial.labels and n in shown - here]
        if empty:
            yield f"{trial.name}: {few(empty)} labelled, but never seen"


def _stand_in(name: str, landmarks: Container[str | None]) -> str | None:
    others = _STANDS_IN.get(canonical(name) or "", ())
    return next((other for other in others if other in landmarks), None)


def _repaired(trial: Trial) -> Iterator[str]:
    for repair in trial.repairs:
        if repair.what in _TOLD:
            count = f"{repair.frames} frame{'s' if repair.frames != 1 else ''}"
            yield f"{trial.name}: {repair.where}: {repair.detail} ({count})"
        elif repair.what == "header" and repair.where in _FRAME_COUNTS:
            yield f"{trial.name}: {repair.detail} frames: it may be a part of a recording"
