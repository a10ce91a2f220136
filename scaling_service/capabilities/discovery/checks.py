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

_FRAMES = 24  # chosen: poses enough to tell a model that never fits from one that strays


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
    """Refuse a model that is metres, sizes or persons away from its recordings (TrialUnusable).

    ``scaled``: whether it was scaled here, or is taken as it is.
    """
    away = (
        LARGEST_M,
        "the model does not fit this recording at all",
        "markers",
        "Check that model and recording are of the same person, that the files' units are right, and that no "
        "labels are exchanged",
    )
    size = (
        UNSCALED_M,
        "the model does not have this person's size",
        "model",
        "Scale it first: leave --start out (`start` over HTTP) or name a method, such as MB",
    )
    scaling = (
        MISFIT_M,
        "the scaled model does not follow this recording",
        "model",
        "Look at the scaling first (`scale`), at the labels under `markers:`, and at whether the static "
        "trial is of this person and day",
    )
    for trial in trials:
        distance = measure_typical_distance(model, trial)
        for limit, what, field, remedy in (away, scaling if scaled else size):
            if distance > limit:
                said = f"half of the markers are more than {1e3 * distance:.0f} mm away from the model's"
                problem = f"{what}: {said}, so no single effect is looked for"
                raise TrialUnusable(problem, file=trial.name, field=field, remedy=remedy)


def measure_typical_distance(model: BodyModel, trial: Trial) -> float:
    """Median distance between measured and model markers over some frames, m."""
    shown = np.flatnonzero(np.any(find_seen(trial.markers), axis=1))
    if len(shown) > _FRAMES:
        shown = shown[np.linspace(0, len(shown) - 1, _FRAMES).round().astype(np.intp)]
    motion = inverse_kinematics(model, trial.frames(shown) if len(shown) else trial)
    return float(np.nanmedian(motion.distances))
