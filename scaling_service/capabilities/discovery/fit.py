"""Whether a model follows the recordings at all; before that, no effect is worth a name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.core.errors import TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.masks import seen

LARGEST_M = 0.08
"""Median distance between measured and model markers above which the two do not belong together, m. Chosen:
three times the mean error of linear scaling (27.4 mm, SD 3.7 mm over 26 persons; Puchaud et al. 2019,
sec. 3.2), which is the worst that a model of the right person does."""

SUSPECT_M = 0.02
"""From here on it is asked whether left and right are exchanged, m (chosen: below it, they are not)."""

_MENDED = 0.5
"""Of the distance: what exchanging the sides must leave at most to be believed. Chosen: on virtual persons a
fortieth is left where the model is theirs. Where it is not scaled yet up to nine tenths are, which is as much
as in a model of another size with the right labels: of such a model it cannot be said."""

_FRAMES = 24
"""Chosen: poses enough to tell a model that never fits from one that strays."""

_OTHER_SIDE = str.maketrans("rlRL", "lrLR")


def check_fits(model: BodyModel, trials: Sequence[Trial]) -> None:
    """Refuse a model that is metres, sizes, sides or persons away from its recordings.

    Parameters
    ----------
    model : BodyModel
        Without parameters.
    trials : sequence of Trial

    Raises
    ------
    TrialUnusable
        A trial's median marker distance is above :data:`LARGEST_M`, or halves once left and right are
        exchanged; or none of its markers is the model's.
    """
    for trial in trials:
        away = typical_distance(model, trial)
        if away > SUSPECT_M and _sides_exchanged(model, trial, away):
            raise TrialUnusable(
                "labels of the left and the right seem to be exchanged: with the other side's labels the "
                f"markers are nearer to the model's than the {1e3 * away:.0f} mm that half of them are away",
                file=trial.name,
                field="markers",
                remedy="Exchange the labels in the recording, or map them under `markers:`",
            )
        if away > LARGEST_M:
            raise TrialUnusable(
                f"the model does not fit this recording at all: half of the markers are more than "
                f"{1e3 * away:.0f} mm away from the model's, so no single effect is looked for",
                file=trial.name,
                field="markers",
                remedy="Check that model and recording are of the same person, that the files' units are "
                "right, and that no labels are exchanged",
            )


def typical_distance(model: BodyModel, trial: Trial) -> float:
    """Median distance between measured and model markers over some frames, m."""
    motion = inverse_kinematics(model, _some(trial))
    return float(np.nanmedian(motion.distances))


def _some(trial: Trial) -> Trial:
    """Some frames that show something, spread over the trial."""
    shown = np.flatnonzero(np.any(seen(trial.markers), axis=1))
    if len(shown) <= _FRAMES:
        return trial.frames(shown) if len(shown) else trial
    return trial.frames(shown[np.linspace(0, len(shown) - 1, _FRAMES).round().astype(np.intp)])


def _sides_exchanged(model: BodyModel, trial: Trial, away: float) -> bool:
    """Whether the other side's labels fit far better."""
    other = mirrored(trial.labels)
    return bool(other) and typical_distance(model, trial.relabelled(other)) < _MENDED * away


def mirrored(labels: Sequence[str]) -> dict[str, str]:
    """Each label to that of the other side, where the side is told by the first or last letter.

    Examples
    --------
    >>> mirrored(["RASIS", "LASIS", "knee_r", "knee_l", "SACR"])
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
