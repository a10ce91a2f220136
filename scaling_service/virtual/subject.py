"""A person made of numbers: known bones, known motion, and recordings of it with the usual faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.streams import stream
from scaling_service.model.anatomy.palpation import landmark_sd
from scaling_service.model.body import BodyModel, Law, Marker, Vector
from scaling_service.model.builtin import builtin, generic_person
from scaling_service.model.compile import compile_model, parameter_values
from scaling_service.model.images import ImageEvidence
from scaling_service.model.parameters import fold, free_axis
from scaling_service.model.scaling import scaled
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.tree import marker_positions
from scaling_service.recording.orientation import Orientation
from scaling_service.recording.pipeline import process
from scaling_service.recording.settings import ProcessingSettings
from scaling_service.virtual import motion
from scaling_service.virtual.artefact import Artefact, draw_artefact, residual, with_artefact
from scaling_service.virtual.cohort import KNEE_AXIS_DEG, Sex, factors_of, person_of, tilt_of_knee

GENERIC = "lower_limb_14dof"

CAMERA_MM: Mapping[str, float] = {"static": 0.2, "dynamic": 0.5}
"""SD of each coordinate in each frame, standing and moving (facts section 8)."""
GAPS_PER_S, GAP_S = 0.02, 0.10
"""Chosen: two or three hidden markers in ten seconds, a tenth of a second on average, so that some are longer
than the 0.15 s that a spline may bridge."""


@dataclass(frozen=True, slots=True)
class VirtualSettings:
    """What is recorded, and how large its faults are (one: as in the literature, zero: none).

    Parameters
    ----------
    placement, artefact, noise, gaps, image : float
        Multiply the placement errors, skin movement, camera noise, the number of gaps and the errors of the
        image (markers and bone surfaces in it).
    functional_s, static_s : float
        Length of each functional movement and of the standing trial.
    strides : float
        In each gait trial.
    """

    placement: float = 1.0
    artefact: float = 1.0
    noise: float = 1.0
    gaps: float = 1.0
    image: float = 1.0
    rate_hz: float = 100.0
    functional_s: float = 10.0
    static_s: float = 2.0
    gait_trials: int = 2
    strides: float = 2.5

    def __post_init__(self) -> None:
        shares = (self.placement, self.artefact, self.noise, self.gaps, self.image, self.gait_trials)
        lengths = (self.rate_hz, self.functional_s, self.static_s, self.strides)
        if min(shares) < 0.0 or min(lengths) <= 0.0:
            raise ValueError("sizes of faults are not negative, lengths and rates are positive")


@dataclass(frozen=True, slots=True, eq=False)
class VirtualSubject:
    """A person of whom everything is known.

    Parameters
    ----------
    model : BodyModel
        The truth: true sizes, knee axes and marker places (skin at rest).
    generic : BodyModel
        What scaling starts from.
    factors : mapping
        Segment to its true size against the generic model.
    tilts : mapping
        Knee to the true turns of its axis about x and y of the thigh, rad.
    marker_offsets : mapping
        Marker to its misplacement on the segment, m.
    artefact : Artefact
        How the skin moves.
    motions : mapping
        Trial to the true coordinates, (n_frames, n_coordinates) in the model's order, rad or m.
    trials : mapping
        Trial to its recording: ``static``, ``hip_r``, ``hip_l``, ``knee_r``, ``knee_l``, ``gait_1`` and on.
    """

    seed: int
    settings: VirtualSettings
    sex: Sex
    height_m: float
    mass_kg: float
    model: BodyModel
    generic: BodyModel
    factors: Mapping[str, float]
    tilts: Mapping[str, tuple[float, float]]
    marker_offsets: Mapping[str, Vector]
    artefact: Artefact
    motions: Mapping[str, Array]
    trials: Mapping[str, Trial]


def virtual_subject(seed: int, settings: VirtualSettings = VirtualSettings()) -> VirtualSubject:
    """A person drawn from the literature's spread, and recorded.

    Parameters
    ----------
    seed : int
        Not negative. Equal seeds are the same person, whatever the settings.

    Notes
    -----
    Every quantity has its own random stream, named after it: leaving one fault out changes no other.

    Examples
    --------
    >>> person = virtual_subject(1)
    >>> person.trials["hip_r"].markers.shape
    (1000, 14, 3)
    """
    generic = builtin(GENERIC)
    sex, height, mass = person_of(seed)
    factors = factors_of(seed, generic, height)
    tilts = {f"knee_{side}": tilt_of_knee(seed, side) for side in KNEE_AXIS_DEG}
    offsets = _placement(seed, generic, settings.placement)
    model = _truth(seed, generic, factors, tilts, offsets, mass)
    style = motion.draw_style(stream(seed, "style"), sex)
    motions = _motions(seed, model, style, height, settings)
    skin = draw_artefact(seed, model, style.stance, settings.artefact)
    trials = {name: _recorded(seed, name, model, skin, q, settings) for name, q in motions.items()}
    return VirtualSubject(
        seed, settings, sex, height, mass, model, generic, factors, tilts, offsets, skin, motions, trials
    )


def demo_session(
    seed: int,
    settings: VirtualSettings = VirtualSettings(),
    *,
    images: bool = False,
    progress: Callable[[str], None] | None = None,
) -> tuple[Session, VirtualSubject]:
    """A virtual subject as a session, recordings processed: functional movements fit, gait is held out.

    Parameters
    ----------
    images : bool
        Whether the person's bones were imaged too; making them and reading their landmarks takes seconds.
    progress : callable, optional
        Called with what is done, where bones are made.
    """
    person = virtual_subject(seed, settings)
    trials = {name: processed(trial, person.generic) for name, trial in person.trials.items()}
    subject = Subject(
        id=f"virtual_{seed}", model=GENERIC, sex=person.sex, height_m=person.height_m, mass_kg=person.mass_kg
    )
    session = Session(
        subject=subject,
        model=person.generic,
        static=trials["static"],
        calibration=tuple(t for name, t in trials.items() if name.startswith(("hip", "knee"))),
        evaluation=tuple(t for name, t in trials.items() if name.startswith("gait")),
        images=_imaged(person, progress) if images else None,
    )
    return session, person


def _imaged(person: VirtualSubject, progress: Callable[[str], None] | None) -> ImageEvidence:
    # Bones are built around a virtual subject, so their module imports this one.
    from scaling_service.virtual.image import image_evidence, virtual_image

    report = progress or _silent
    image = virtual_image(person, progress=lambda bone: report(f"making the {bone}"))
    return image_evidence(image, progress=lambda bone: report(f"landmarks of the {bone}"))


def _silent(what: str) -> None:
    """No progress is shown."""


def processed(trial: Trial, model: BodyModel, settings: ProcessingSettings | None = None) -> Trial:
    """A virtual recording after the usual smoothing and filling; its axes are right already."""
    clusters = {
        segment: tuple(m.name for m in model.markers if m.segment == segment and m.weight > 0.0)
        for segment in model.segment_names
    }
    return process(trial, Orientation(np.eye(3), 1.0, "up +y, forward +x"), clusters, settings)


def _placement(seed: int, generic: BodyModel, size: float) -> dict[str, Vector]:
    offsets = {}
    for marker in generic.markers:
        if marker.weight > 0.0:
            spread = size * np.array(landmark_sd(marker.name))
            x, y, z = (float(v) for v in spread * stream(seed, "placement", marker.name).normal(size=3))
            offsets[marker.name] = (x, y, z)
    return offsets


def _truth(
    seed: int,
    generic: BodyModel,
    factors: Mapping[str, float],
    tilts: Mapping[str, tuple[float, float]],
    offsets: Mapping[str, Vector],
    mass: float,
) -> BodyModel:
    depicted = sum(s.mass for s in generic.segments) / generic_person(GENERIC).mass_kg
    model = scaled(generic, {name: (f, f, f) for name, f in factors.items()}, mass_kg=mass * depicted)
    for joint in tilts:
        model = free_axis(model, joint, np.inf, np.inf)
    values = {
        f"axis.{joint}.{letter}": v
        for joint, turns in tilts.items()
        for letter, v in zip("xy", turns, strict=True)
    }
    markers = tuple(_moved(m, offsets[m.name]) if m.name in offsets else m for m in model.markers)
    return replace(fold(model.with_markers(markers), values), name=f"virtual_{seed}")


def _moved(marker: Marker, by: Vector) -> Marker:
    x, y, z = (law + Law.constant(shift) for law, shift in zip(marker.laws, by, strict=True))
    return replace(marker, laws=(x, y, z))


def _motions(
    seed: int, model: BodyModel, style: motion.Style, height: float, settings: VirtualSettings
) -> dict[str, Array]:
    def clock(duration: float) -> Array:
        return _times(duration, settings.rate_hz)

    found = {
        "static": motion.standing(model, style, clock(settings.static_s), stream(seed, "static"), height)
    }
    for name, movement in (("hip", motion.hip_movement), ("knee", motion.knee_movement)):
        for side in motion.OTHER:
            rng = stream(seed, "motion", name, side)
            found[f"{name}_{side}"] = movement(model, style, side, clock(settings.functional_s), rng, height)
    for k in range(1, settings.gait_trials + 1):
        times = clock(settings.strides * style.stride_s)
        found[f"gait_{k}"] = motion.walking(model, style, times, stream(seed, "motion", "gait", k), height)
    return found


def _times(duration: float, rate_hz: float) -> Array:
    return np.arange(max(2, round(duration * rate_hz))) / rate_hz


def _recorded(
    seed: int, name: str, model: BodyModel, skin: Artefact, q: Array, settings: VirtualSettings
) -> Trial:
    labels = tuple(m.name for m in model.markers if m.weight > 0.0)
    times = np.arange(len(q)) / settings.rate_hz
    moving = with_artefact(model, skin)
    markers = marker_positions(compile_model(moving, labels), q, parameter_values(moving))
    still = name == "static"
    spread = 1e-3 * settings.noise * CAMERA_MM["static" if still else "dynamic"]
    markers = markers + spread * stream(seed, "camera", name).normal(size=markers.shape)
    if not still:
        for k, label in enumerate(labels):
            markers[:, k] += residual(skin, stream(seed, "artefact", name, label), times)
            markers[_hidden(stream(seed, "gaps", name, label), times, settings.gaps), k] = np.nan
    return Trial(name, times, labels, markers, settings.rate_hz)


def _hidden(rng: np.random.Generator, times: Array, size: float) -> NDArray[np.bool_]:
    """Whether a marker is hidden in each frame, never in the first or last."""
    hidden = np.zeros(len(times), dtype=bool)
    for _ in range(rng.poisson(size * GAPS_PER_S * times[-1])):
        start = rng.uniform(0.0, times[-1])
        hidden |= (times >= start) & (times < start + rng.exponential(GAP_S))
    hidden[[0, -1]] = False
    return hidden
