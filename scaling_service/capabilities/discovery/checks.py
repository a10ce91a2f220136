"""What is refused before the search."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.problem import find_seen
from scaling_service.numerics.signals.splines import MIN_SAMPLES

LARGEST_M = 0.08
"""Median distance between measured and model markers above which the two do not belong together, m. Chosen:
three times the mean error of linear scaling (27.4 mm, SD 3.7 mm over 26 persons; Puchaud et al. 2019,
sec. 3.2), which is the worst that a model of the right person does."""

UNSCALED_M = 0.035
"""The same for a model that is taken as it is, m: two standard deviations above that mean error. A model of
another person's size would be given a dozen effects."""

MISFIT_M = 0.04
"""The same for a model that was scaled here, m: three standard deviations above that mean error."""

SUSPECT_M = 0.02
"""From here on it is asked whether left and right are exchanged, m (chosen: below it, they are not)."""

_MENDED = 0.5
"""Of the distance: what exchanging the sides must leave at most to be believed. Chosen: on virtual persons a
fortieth is left where the model is theirs. Where it is not scaled yet up to nine tenths are, which is as much
as in a model of another size with the right labels: of such a model it cannot be said."""

_FRAMES = 24  # chosen: poses enough to tell a model that never fits from one that strays
_OTHER_SIDE = str.maketrans("rlRL", "lrLR")


def check_lengths(trials: Sequence[Trial]) -> None:
    """Refuse trials with too few frames for accelerations, and having none at all (TrialUnusable)."""
    if not trials:
        raise TrialUnusable(
            "there is no movement to compare with the model",
            field="trials",
            remedy="Name recordings under `calibration:` and `evaluation:`",
        )
    for trial in trials:
        if trial.n_frames < MIN_SAMPLES:
            raise TrialUnusable(
                f"too few frames for a movement, {trial.n_frames}: accelerations take {MIN_SAMPLES} at least",
                file=trial.name,
                field="trials",
                remedy="Leave it out, or name a recording of standing under `static:`",
            )


def check_fits(model: BodyModel, trials: Sequence[Trial], *, scaled: bool) -> None:
    """Refuse a model that is metres, sizes, sides or persons away from its recordings (TrialUnusable).

    ``scaled``: whether it was scaled here, or is taken as it is.
    """
    for trial in trials:
        away = measure_typical_distance(model, trial)
        if away > SUSPECT_M and _are_sides_exchanged(model, trial, away):
            raise TrialUnusable(
                "labels of the left and the right seem to be exchanged: with the other side's labels the "
                f"markers are nearer to the model's than the {1e3 * away:.0f} mm that half of them are away",
                file=trial.name,
                field="markers",
                remedy="Exchange the labels in the recording, or map them under `markers:`",
            )
        for wrong, what, field, remedy in (
            (
                away > LARGEST_M,
                "the model does not fit this recording at all",
                "markers",
                "Check that model and recording are of the same person, that the files' units are right, and "
                "that no labels are exchanged",
            ),
            (
                scaled and away > MISFIT_M,
                "the scaled model does not follow this recording",
                "model",
                "Look at the scaling first (`scale`), at the labels under `markers:`, and at whether the "
                "static trial is of this person and day",
            ),
            (
                not scaled and away > UNSCALED_M,
                "the model does not have this person's size",
                "model",
                "Scale it first: leave --start out (`start` over HTTP) or name a method, such as MB",
            ),
        ):
            if wrong:
                said = f"half of the markers are more than {1e3 * away:.0f} mm away from the model's"
                raise TrialUnusable(
                    f"{what}: {said}, so no single effect is looked for",
                    file=trial.name,
                    field=field,
                    remedy=remedy,
                )


def measure_typical_distance(model: BodyModel, trial: Trial) -> float:
    """Median distance between measured and model markers over some frames, m."""
    shown = np.flatnonzero(np.any(find_seen(trial.markers), axis=1))
    if len(shown) > _FRAMES:
        shown = shown[np.linspace(0, len(shown) - 1, _FRAMES).round().astype(np.intp)]
    motion = inverse_kinematics(model, trial.frames(shown) if len(shown) else trial)
    return float(np.nanmedian(motion.distances))


def _are_sides_exchanged(model: BodyModel, trial: Trial, away: float) -> bool:
    """Whether the other side's labels fit far better."""
    other = mirror_labels(trial.labels)
    return bool(other) and measure_typical_distance(model, trial.relabel(other)) < _MENDED * away


def mirror_labels(labels: Sequence[str]) -> dict[str, str]:
    """Each label to that of the other side, where the first or last letter gives the side.

    Examples
    --------
    >>> mirror_labels(["RASIS", "LASIS", "knee_r", "knee_l", "SACR"])
    {'RASIS': 'LASIS', 'LASIS': 'RASIS', 'knee_r': 'knee_l', 'knee_l': 'knee_r'}
    """
    known = {label.lower(): label for label in labels}
    found: dict[str, str] = {}
    for label in labels:
        first = label[:1].translate(_OTHER_SIDE) + label[1:]
        last = label[:-1] + label[-1:].translate(_OTHER_SIDE)
        for other in (first, last):
            if other != label and other.lower() in known:
                found.setdefault(label, known[other.lower()])
    return found
