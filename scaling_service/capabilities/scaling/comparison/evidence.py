"""What a verdict on scaled models rests on."""

from __future__ import annotations

import dataclasses
import math
from collections import abc

import numpy as np

from scaling_service.capabilities.motion.kinematic_error import KinematicError


@dataclasses.dataclass(frozen=True, slots=True)
class Following:
    """How closely a model follows markers over several trials, each trial counting the same, m.

    ``mean``: mean over trials of the kinematic error.
    ``max``: the largest distance of any marker in any frame.
    """

    mean: float
    max: float


@dataclasses.dataclass(frozen=True, slots=True)
class Moment:
    """Where and when a marker is farthest from a model's, m and s."""

    marker: str
    trial: str
    time: float
    distance: float


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MethodEvidence:
    """What is known of one method's model.

    ``from_images``: whether its lengths and joint centres come from images alone.
    ``skin``: how much its markers move over its bones against what skin does in ordinary people; None for
        a method that does not estimate it.
    ``worst``: the moment of the largest distance over all trials; None where nothing was seen.
    ``fitted``, ``held_out``: on the trials that it may have been fitted to, and on those that it was not.
    ``lengths``: ``femur_r`` … to m.
    ``length_sds``, ``centre_sds``: ``femur_r`` …, ``hip_r`` … to standard deviations, m, where they are
        known; a centre's in space.
    ``angle_sds``: joint angle to its standard deviation, rad, over the trials judged on.
    ``stops``: joints that stand at the end of their range for long, a sentence each.
    ``by_people``: sizes, centres and axes of which people in general say more than images and recordings.
    """

    method: str
    from_images: bool = False
    skin: float | None = None
    worst: Moment | None = None
    fitted: Following | None = None
    held_out: Following | None = None
    lengths: abc.Mapping[str, float] = dataclasses.field(default_factory=dict)
    length_sds: abc.Mapping[str, float] = dataclasses.field(default_factory=dict)
    centre_sds: abc.Mapping[str, float] = dataclasses.field(default_factory=dict)
    angle_sds: abc.Mapping[str, float] = dataclasses.field(default_factory=dict)
    by_people: tuple[str, ...] = ()
    stops: tuple[str, ...] = ()

    @property
    def judged_on(self) -> Following | None:
        """Held-out trials where there are any, else those it was fitted to."""
        return self.held_out or self.fitted


@dataclasses.dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of all methods' models of one person.

    ``methods``: at least one.
    ``imaged``: joint centres that images show: ``hip_r``, ``knee_r``, ``ankle_r`` and the left ones.
    ``usual_lengths``: ``femur_r`` … to what is usual for the person's height, m; empty where the height is
        not known.
    ``contradictions``: by which recordings and images look like more than one body, a sentence each.
    """

    methods: tuple[MethodEvidence, ...]
    imaged: frozenset[str] = frozenset()
    usual_lengths: abc.Mapping[str, float] = dataclasses.field(default_factory=dict)
    contradictions: tuple[str, ...] = ()

    @property
    def reference(self) -> MethodEvidence | None:
        """The method whose lengths and centres stand for the image's, if any was computed."""
        return next((m for m in self.methods if m.from_images), None)


def average_errors(errors: abc.Mapping[str, KinematicError], trials: abc.Iterable[str]) -> Following | None:
    """Over trials that show any marker; None if there is none.

    Examples
    --------
    >>> error = KinematicError(
    ...     mean=0.004, sd=0.0, rms=0.004, max=0.01, per_marker={}, anatomical_mean=0.004,
    ...     tracking_mean=0.004, n_frames=1,
    ... )
    >>> average_errors({"hip": error}, ["hip", "walk"])
    Following(mean=0.004, max=0.01)
    """
    known = [errors[name] for name in trials if name in errors and not math.isnan(errors[name].mean)]
    if not known:
        return None
    return Following(mean=float(np.mean([e.mean for e in known])), max=max(e.max for e in known))
