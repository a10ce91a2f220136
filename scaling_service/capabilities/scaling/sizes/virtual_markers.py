"""Landmarks that a model wants and that were not recorded, from those that were."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from scaling_service.model.anatomy.centres import Centre
from scaling_service.model.anatomy.markers import canonical
from scaling_service.model.body import BodyModel, Marker
from scaling_service.model.trial import Trial
from scaling_service.numerics.least_squares.masks import ever, seen
from scaling_service.numerics.multibody.laws import Array

_OPPOSITE = (("knee", "LFE", "MFE"), ("ankle", "LM", "MM"))
"""Joint, lateral landmark, and the medial one that lies as far on the other side of the centre."""

SACRUM = "SACR"


def with_sacrum(model: BodyModel, trials: Iterable[Trial]) -> BodyModel:
    """The model with a sacral marker half-way between its PSIS, where recordings show one and no PSIS.

    It takes the name of the label; a model that has such a marker is left as it is.
    """
    shown = {label for trial in trials for label in _labels_seen(trial)}
    landmarks = {canonical(label) for label in shown}
    marked = {canonical(m.name): m for m in model.markers}
    labels = [label for label in shown if canonical(label) == SACRUM]
    if (
        not labels
        or landmarks & {"RPSIS", "LPSIS"}
        or SACRUM in marked
        or not {"RPSIS", "LPSIS"} <= marked.keys()
    ):
        return model
    right, left = marked["RPSIS"], marked["LPSIS"]
    x, y, z = np.add(right.nominal, left.nominal) / 2.0
    new = Marker.at(sorted(labels)[0], right.segment, (float(x), float(y), float(z)), weight=right.weight)
    return model.with_markers((*model.markers, new))


def with_virtual_landmarks(trial: Trial, centres: Mapping[str, Centre]) -> Trial:
    """The trial with medial epicondyles and malleoli that it does not show, mirrored at the joint's centre.

    Parameters
    ----------
    trial : Trial
        A standing trial.
    centres : mapping
        ``knee_r`` … in the frames of this trial.
    """
    at = {canonical(label): trial.position(label) for label in _labels_seen(trial)}
    added: dict[str, Array] = {}
    for joint, lateral, medial in _OPPOSITE:
        for side in "rl":
            outer, inner = f"{side.upper()}{lateral}", f"{side.upper()}{medial}"
            centre = centres.get(f"{joint}_{side}")
            if centre is not None and len(centre.at) == trial.n_frames and outer in at and inner not in at:
                added[inner] = 2.0 * centre.at - at[outer]
    if not added:
        return trial
    kept = [k for k, label in enumerate(trial.labels) if label not in added]
    return replace(
        trial,
        labels=(*(trial.labels[k] for k in kept), *added),
        markers=np.concatenate([trial.markers[:, kept], np.stack([*added.values()], axis=1)], axis=1),
    )


def _labels_seen(trial: Trial) -> list[str]:
    present = ever(seen(trial.markers))
    return [label for label, once in zip(trial.labels, present, strict=True) if once]
