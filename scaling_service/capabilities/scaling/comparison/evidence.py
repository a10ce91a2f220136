"""What a verdict on scaled models rests on, and what it says."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from scaling_service.capabilities.motion.kinematic_error import KinematicError
from scaling_service.documents.results import TrustNote
from scaling_service.model.body import Vector

Speaks = Literal["for", "against", "neither"]

Strength = Literal["decided", "leaning", "undecided"]
"""Whether the evidence settles which method to use, favours one without a check, or leaves it open."""


@dataclass(frozen=True, slots=True)
class Following:
    """How closely a model follows markers over several trials, each trial counting the same, m.

    ``mean``: mean over trials of the kinematic error.
    ``rms``: root of the mean over trials of the squared root mean square distance.
    ``max``: the largest distance of any marker in any frame.
    """

    mean: float
    rms: float
    max: float
    trials: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodEvidence:
    """What is known of one method's model.

    ``start``: the method whose model was the first guess.
    ``from_images``: whether its lengths and joint centres come from images.
    ``fits_lengths``: whether segment lengths were among the fitted numbers.
    ``fitted``, ``held_out``: on the trials that it may have been fitted to, and on those that it was not.
    ``parameters``, ``undetermined``, ``at_bounds``: how many numbers were fitted, how many of them the
        recordings do not determine, and how many stopped at a bound.
    ``lengths``: ``femur_r`` … to m.
    ``hip_centres``: ``hip_r``, ``hip_l`` to the position in the pelvis, m.
    ``knee_axes``: ``r``, ``l`` to the turns of the axis about x and y of the thigh, rad.
    ``length_sds``: ``femur_r`` … to the standard deviation of its estimate, m, where distances and
        anthropometry gave it.
    ``inferred``: segments of which nothing was measured.
    """

    method: str
    start: str | None = None
    from_images: bool = False
    fits_lengths: bool = False
    fitted: Following | None = None
    held_out: Following | None = None
    parameters: int = 0
    undetermined: int = 0
    at_bounds: int = 0
    lengths: Mapping[str, float] = field(default_factory=dict)
    hip_centres: Mapping[str, Vector] = field(default_factory=dict)
    knee_axes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    length_sds: Mapping[str, float] = field(default_factory=dict)
    inferred: tuple[str, ...] = ()

    @property
    def judged_on(self) -> Following | None:
        """Held-out trials where there are any, else those it was fitted to."""
        return self.held_out or self.fitted


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of all methods' models of one person.

    ``methods``: at least one.
    ``imaged``: joint centres that images show: ``hip_r``, ``knee_r``, ``ankle_r`` and the left ones.
    ``usual_lengths``: ``femur_r`` … to what is usual for the person's height, m; empty where the height is
        not known.
    ``angles_apart``: two methods (in the order of ``methods``) to the joint angle in which they differ most
        and the root mean square of that difference, rad; on held-out trials where there are any.
    """

    methods: tuple[MethodEvidence, ...]
    imaged: frozenset[str] = frozenset()
    usual_lengths: Mapping[str, float] = field(default_factory=dict)
    angles_apart: Mapping[tuple[str, str], tuple[str, float]] = field(default_factory=dict)

    def method(self, name: str) -> MethodEvidence:
        """The method of that name (KeyError if none)."""
        for method in self.methods:
            if method.method == name:
                return method
        raise KeyError(name)

    @property
    def reference(self) -> MethodEvidence | None:
        """The method whose lengths and centres stand for the image's, if any was computed."""
        return next((m for m in self.methods if m.from_images), None)

    @property
    def imaged_lengths(self) -> tuple[str, ...]:
        """The lengths between imaged joint centres."""
        sides = ("r", "l")
        pairs = {"inter_hip": ("hip_r", "hip_l")}
        pairs |= {f"femur_{s}": (f"hip_{s}", f"knee_{s}") for s in sides}
        pairs |= {f"shank_{s}": (f"knee_{s}", f"ankle_{s}") for s in sides}
        return tuple(name for name, ends in pairs.items() if set(ends) <= self.imaged)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """A limit that a usable model keeps: necessary, not sufficient."""

    method: str
    quantity: Literal["rms", "max"]
    value: float
    limit: float
    held_out: bool

    @property
    def passed(self) -> bool:
        """Whether the value stays below the limit."""
        return self.value < self.limit


@dataclass(frozen=True, slots=True)
class Finding:
    """What one rule says of one method."""

    rule: str
    method: str
    speaks: Speaks
    text: str


@dataclass(frozen=True, slots=True)
class ImageAgreement:
    """A model against the image: differences over what was imaged.

    ``lengths``: length to model minus image, m.
    ``hips``: hip to the distance between the centres in the pelvis, m.
    """

    lengths: Mapping[str, float]
    hips: Mapping[str, float]

    @property
    def worst(self) -> float:
        """The largest size of any of them, m; NaN if nothing could be compared."""
        return max((abs(v) for v in (*self.lengths.values(), *self.hips.values())), default=float("nan"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Which method to use for a person, why, and how far to trust it.

    ``method``: the one to use, or the one to lean to where the evidence does not decide.
    ``why``: plain sentences.
    ``findings``: what every rule says of every method.
    """

    method: str
    strength: Strength
    headline: str
    why: tuple[str, ...]
    trust: tuple[TrustNote, ...]
    gates: tuple[Gate, ...]
    findings: tuple[Finding, ...]


def average_errors(errors: Mapping[str, KinematicError], trials: Iterable[str]) -> Following | None:
    """Over trials that show any marker; None if there is none.

    Examples
    --------
    >>> error = KinematicError(
    ...     mean=0.004, sd=0.0, rms=0.004, max=0.01, per_marker={}, anatomical_mean=0.004,
    ...     tracking_mean=0.004, n_frames=1,
    ... )
    >>> average_errors({"hip": error}, ["hip", "walk"])
    Following(mean=0.004, rms=0.004, max=0.01, trials=1)
    """
    known = [errors[name] for name in trials if name in errors and not math.isnan(errors[name].mean)]
    if not known:
        return None
    return Following(
        mean=float(np.mean([e.mean for e in known])),
        rms=float(np.sqrt(np.mean([e.rms**2 for e in known]))),
        max=max(e.max for e in known),
        trials=len(known),
    )
