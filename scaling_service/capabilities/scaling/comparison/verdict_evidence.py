"""What a verdict on scaled models rests on, and what it says: frozen values, no files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from scaling_service.model.body import Vector

Level = Literal["good", "fair", "poor", "unknown"]
"""How far something can be trusted; ``unknown`` where nothing was measured that could tell."""

Strength = Literal["decided", "leaning", "undecided"]
"""Whether the evidence settles which method to use, favours one without a check, or leaves it open."""


@dataclass(frozen=True, slots=True)
class Following:
    """How closely a model follows markers over several trials, each trial counting the same, m.

    Parameters
    ----------
    mean : float
        Mean over trials of the kinematic error.
    rms : float
        Root of the mean over trials of the squared root mean square distance.
    max : float
        The largest distance of any marker in any frame.
    trials : int
    """

    mean: float
    rms: float
    max: float
    trials: int


@dataclass(frozen=True, slots=True)
class MethodEvidence:
    """What is known of one method's model.

    Parameters
    ----------
    method : str
    start : str, optional
        The method whose model was the first guess.
    from_images : bool
        Whether its lengths and joint centres come from images.
    fits_lengths : bool
        Whether segment lengths were among the fitted numbers.
    fitted, held_out : Following, optional
        On the trials that it may have been fitted to, and on those that it was not.
    parameters, undetermined, at_bounds : int
        How many numbers were fitted, how many of them the recordings do not determine, and how many
        stopped at a bound.
    lengths : mapping
        ``femur_r`` … to m.
    hip_centres : mapping
        ``hip_r``, ``hip_l`` to the position in the pelvis, m.
    knee_axes : mapping
        ``r``, ``l`` to the turns of the axis about x and y of the thigh, rad.
    length_sds : mapping
        ``femur_r`` … to the standard deviation of its estimate, m, where distances and anthropometry gave it.
    inferred : tuple of str
        Segments of which nothing was measured.
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

    Parameters
    ----------
    methods : tuple of MethodEvidence
        At least one.
    imaged : frozenset of str
        Joint centres that images show: ``hip_r``, ``knee_r``, ``ankle_r`` and the left ones.
    usual_lengths : mapping
        ``femur_r`` … to what is usual for the person's height, m; empty where the height is not known.
    usual_spread : float
        Share of the usual length beyond which a length is implausible.
    angles_apart : mapping
        Two methods (in the order of ``methods``) to the joint angle in which they differ most and the root
        mean square of that difference, rad; on held-out trials where there are any.
    """

    methods: tuple[MethodEvidence, ...]
    imaged: frozenset[str] = frozenset()
    usual_lengths: Mapping[str, float] = field(default_factory=dict)
    usual_spread: float = 0.2
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


@dataclass(frozen=True, slots=True)
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
    speaks: Literal["for", "against", "neither"]
    text: str


@dataclass(frozen=True, slots=True)
class Trust:
    """How far to trust one thing of the method chosen."""

    topic: str
    level: Level
    text: str


@dataclass(frozen=True, slots=True)
class ImageAgreement:
    """A model against the image: differences over what was imaged.

    Parameters
    ----------
    lengths : mapping
        Length to model minus image, m.
    hips : mapping
        Hip to the distance between the centres in the pelvis, m.
    """

    lengths: Mapping[str, float]
    hips: Mapping[str, float]

    @property
    def worst(self) -> float:
        """The largest size of any of them, m; NaN if nothing could be compared."""
        return max((abs(v) for v in (*self.lengths.values(), *self.hips.values())), default=float("nan"))


@dataclass(frozen=True, slots=True)
class Verdict:
    """Which method to use for a person, why, and how far to trust it.

    Parameters
    ----------
    method : str
        The one to use, or the one to lean to where the evidence does not decide.
    strength : Strength
    headline : str
    why : tuple of str
        Plain sentences.
    trust : tuple of Trust
    gates : tuple of Gate
    findings : tuple of Finding
        What every rule says of every method.
    agreement : mapping
        Method to how it agrees with the image; empty without images.
    """

    method: str
    strength: Strength
    headline: str
    why: tuple[str, ...]
    trust: tuple[Trust, ...]
    gates: tuple[Gate, ...]
    findings: tuple[Finding, ...]
    agreement: Mapping[str, ImageAgreement] = field(default_factory=dict)
