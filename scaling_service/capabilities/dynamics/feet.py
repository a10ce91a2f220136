"""Which segments of a model are feet, and which markers of a recording sit on them."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from scaling_service.core.errors import ModelRefused, TrialUnusable
from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Array, Trial
from scaling_service.numerics.least_squares.masks import ever, seen

_FOOT = re.compile("calcn|foot", re.IGNORECASE)
_COMPANY = ("toes", "talus", "hallux")
"""Segments of OpenSim's models that belong to the foot of the same side."""

FEWEST = 2
"""Markers that show where a foot is and how it points."""


def feet_of(model: BodyModel) -> dict[str, tuple[str, ...]]:
    """The segments that bear loads, each with the segments that stand on the floor with it.

    Raises
    ------
    ModelRefused
        The model ends above its feet, or has one only.
    """
    feet = {
        name: tuple(
            s for s in model.segment_names if s == name or s in {_FOOT.sub(other, name) for other in _COMPANY}
        )
        for name in model.segment_names
        if _FOOT.search(name)
    }
    if not feet:
        raise ModelRefused(
            f"model '{model.name}' has no feet, so the ground's forces act on nothing",
            field="model",
            remedy="Use a model of the whole body, such as full_body_35dof, or one whose feet are called "
            "calcn_r and calcn_l",
        )
    if len(feet) == 1:
        raise ModelRefused(
            f"model '{model.name}' has one foot, but the ground bears a person by both",
            field="model",
            remedy="Use a model of the whole body; the planar squat is for `consistent`",
        )
    return feet


def foot_markers(model: BodyModel, trial: Trial, extra: Mapping[str, str]) -> dict[str, Array]:
    """Markers on each foot, (n_frames, n_markers, 3), m.

    Parameters
    ----------
    model : BodyModel
    trial : Trial
        With the model's marker names.
    extra : mapping
        Further labels of the recordings to the segment that each sits on.

    Raises
    ------
    ModelRefused
        The model has no feet.
    TrialUnusable
        A foot shows too few markers to tell which plate it stands on.
    """
    shown = {name for name, once in zip(trial.labels, ever(seen(trial.markers)), strict=True) if once}
    sits = {m.name: m.segment for m in model.markers} | dict(extra)
    found = {}
    for foot, segments in feet_of(model).items():
        labels = [label for label in trial.labels if label in shown and sits.get(label) in segments]
        if len(labels) < FEWEST:
            raise TrialUnusable(
                f"foot '{foot}' shows {' and '.join(labels) or 'no marker'}; heel and toe at least are "
                "needed to tell which plate it stands on",
                file=trial.name,
                field=foot,
                remedy=f"Name further labels on '{foot}' under `extra_markers:` in the subject file",
            )
        found[foot] = np.stack([trial.position(label) for label in labels], axis=1)
    return found
