"""Segments' poses from their own markers, as motions away from one posture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.model.body import BodyModel
from scaling_service.model.trial import Trial
from scaling_service.numerics.geometry.functional import Poses
from scaling_service.numerics.least_squares.masks import ever, seen
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.rigid import fit_rigid

FOREIGN_M = 0.03
"""RMS misfit of a cluster beyond which a label is another marker's. Chosen: skin deforms a segment's
markers by 4 to 16 mm (fluoroscopy of six knees, PMC8631460); exchanged epicondyles leave 40 mm and more."""


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """The markers of one segment where they are in the posture: ``local`` is (n_markers, 3), m."""

    segment: str
    labels: tuple[str, ...]
    local: Array

    def poses(self, trial: Trial) -> Poses:
        """How the segment has moved since the posture.

        NaN in frames that show fewer than three of its markers, or markers that do not fit each other.

        References
        ----------
        Soderkvist & Wedin 1993, J Biomech 26:1473-1477.
        """
        measured = trial.selected(self.labels).markers
        rotation, position = fit_rigid(self.local, measured)
        gaps = np.einsum("nij,mj->nmi", rotation, self.local) + position[:, None] - measured
        squared = np.where(seen(gaps), (gaps**2).sum(axis=2), 0.0).sum(axis=1)
        foreign = squared > FOREIGN_M**2 * np.maximum(seen(gaps).sum(axis=1), 1)
        rotation[foreign], position[foreign] = np.nan, np.nan
        return Poses(rotation, position)

    def shown(self, trials: Iterable[Trial]) -> tuple[str, ...]:
        """Those of its labels that at least one of the trials shows."""
        found = {t.labels[k] for t in trials for k in np.flatnonzero(ever(seen(t.markers)))}
        return tuple(label for label in self.labels if label in found)


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """A person in one posture.

    Parameters
    ----------
    points : mapping
        Label to its place in ground, (3,), m.
    carriers : mapping
        Segment to the labels on it.
    """

    points: Mapping[str, Array]
    carriers: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(
        cls, model: BodyModel, extra: Mapping[str, str], static: Trial | None, trials: Sequence[Trial]
    ) -> Posture:
        """The mean of the static trial; without one, the frame of the others that shows most markers.

        Parameters
        ----------
        extra : mapping
            Further labels, and the segment that each sits on.
        """
        carriers: dict[str, list[str]] = {}
        for marker in model.markers:
            if marker.weight > 0.0:
                carriers.setdefault(marker.segment, []).append(marker.name)
        for label, segment in extra.items():
            if label not in model.marker_names:
                carriers.setdefault(segment, []).append(label)
        labels = [label for own in carriers.values() for label in own]
        points = _mean(static, labels) if static is not None else _fullest(trials, labels)
        return cls(
            points, {name: tuple(label for label in own if label in points) for name, own in carriers.items()}
        )

    def cluster(self, segment: str) -> Cluster:
        """The markers of a segment; it may be too few of them."""
        labels = self.carriers.get(segment, ())
        return Cluster(segment, labels, np.array([self.points[label] for label in labels]).reshape(-1, 3))

    def as_trial(self) -> Trial:
        """The posture as a recording of one frame."""
        labels = tuple(self.points)
        places = np.array([self.points[label] for label in labels]).reshape(1, -1, 3)
        return Trial("posture", np.zeros(1), labels, places, 1.0)


def _mean(trial: Trial, labels: Sequence[str]) -> dict[str, Array]:
    places = trial.selected(labels).markers
    shown = ever(seen(places))
    return {label: np.nanmean(places[:, k], axis=0) for k, label in enumerate(labels) if shown[k]}


def _fullest(trials: Sequence[Trial], labels: Sequence[str]) -> dict[str, Array]:
    every = np.concatenate(
        [np.full((1, len(labels), 3), np.nan), *(t.selected(labels).markers for t in trials)]
    )
    shown = seen(every)
    frame = int(np.argmax(shown.sum(axis=1)))
    return {label: every[frame, k] for k, label in enumerate(labels) if shown[frame, k]}
