"""Virtual persons: known bones and motion, drawn as in Puchaud 2019, and recordings with usual faults."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Literal

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.core.streams import stream
from scaling_service.model import body, builtin, parameters
from scaling_service.model.anatomy.centres import look_up_landmark_sd
from scaling_service.model.compile import compile_model, list_parameter_values
from scaling_service.model.scaling import scale_model
from scaling_service.model.subject import Session, Subject
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.recording.orientation import Orientation
from scaling_service.recording.pipeline import process
from scaling_service.recording.settings import ProcessingSettings
from scaling_service.virtual import artefact as artefacts
from scaling_service.virtual import motion

Sex = Literal["F", "M"]

STATURE_M = (1.762, 0.076)
"""Mean and SD of the cohort of Puchaud 2019 (section 2.1)."""
MALE_SHARE = 22.0 / 26.0
"""Puchaud 2019, section 2.1."""
SEX_GAP_M = 0.127
"""Men over women: 1.756 - 1.629 m (ANSUR II 2012)."""
BMI = (21.6, 2.14)
"""kg/m2, mean and SD: Puchaud 2019, section 2.1."""

FEMUR, SHANK, INTER_HIP = (0.2454, 0.012), (0.2356, 0.011), (0.0985, 0.008)
"""Mean as a share of stature (EOS, Puchaud 2019, table 2) and SD about it in m (facts section 10, from the
table's SDs)."""
FEMUR_SHANK_CORRELATION = 0.8
"""Proposed (facts section 10)."""
SIDE_SD_M = 0.00325
"""Of one bone's length about the mean of both sides: legs differ by 5.2 mm on average (Knutson 2005,
Chiropr Osteopat 13:11, from radiographs), so by 6.5 mm SD, half of the variance in each bone."""

KNEE_AXIS_DEG: Mapping[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "r": ((1.94, 1.83), (-2.02, 2.10)),
    "l": ((-0.81, 1.84), (0.81, 2.16)),
}
"""Mean and SD of the turns about x and y of the thigh (Puchaud 2019, table 3, EB_a,m*)."""

GENERIC = "lower_limb_14dof"

CAMERA_MM: Mapping[str, float] = {"static": 0.2, "dynamic": 0.5}
"""SD of each coordinate in each frame, standing and moving (facts section 8)."""
GAPS_PER_S, GAP_S = 0.02, 0.10
"""Chosen: two or three hidden markers in ten seconds, a tenth of a second on average, so that some are longer
than the 0.15 s that a spline may bridge."""


def read_stature_spread(sex: Sex) -> tuple[float, float]:
    """Mean and SD of the stature (m) of one sex in the cohort."""
    mean, sd = STATURE_M
    mean += SEX_GAP_M * ((1.0 - MALE_SHARE) if sex == "M" else -MALE_SHARE)
    return mean, float(np.sqrt(sd**2 - MALE_SHARE * (1.0 - MALE_SHARE) * SEX_GAP_M**2))


def draw_person(seed: int) -> tuple[Sex, float, float]:
    """Sex, stature (m) and mass (kg); both sexes together have the cohort's mean and SD of stature."""
    rng = stream(seed, "person")
    sex: Sex = "M" if rng.random() < MALE_SHARE else "F"
    height = float(rng.normal(*read_stature_spread(sex)))
    return sex, height, float(max(rng.normal(*BMI), 16.0) * height**2)


def draw_factors(seed: int, generic: body.BodyModel, height: float) -> dict[str, float]:
    """Each segment's size against the generic model, for a person of a stature (m)."""
    rng = stream(seed, "lengths")
    common = rng.normal()
    across = np.sqrt(1.0 - FEMUR_SHANK_CORRELATION**2) * rng.normal()
    femur = FEMUR[0] * height + FEMUR[1] * common
    shank = SHANK[0] * height + SHANK[1] * (FEMUR_SHANK_CORRELATION * common + across)
    inter_hip = INTER_HIP[0] * height + INTER_HIP[1] * rng.normal()
    factors = {"pelvis": float(inter_hip / (2.0 * _find_offset(generic, "femur_r")[2]))}
    for side in ("r", "l"):
        for bone, length, reach in (
            ("femur", femur, _find_offset(generic, f"tibia_{side}")),
            ("tibia", shank, np.array(generic.marker(f"{side.upper()}AJC").nominal)),
        ):
            own = length + SIDE_SD_M * stream(seed, "lengths", bone, side).normal()
            factors[f"{bone}_{side}"] = float(own / np.linalg.norm(reach))
    return factors


def _find_offset(model: body.BodyModel, segment: str) -> Array:
    """Where a segment's joint sits in its parent, m."""
    shifts = [j for j in model.segment(segment).joints if j.kind == "translation"]
    return sum((np.array(j.axis) * j.law.constant_part for j in shifts), np.zeros(3))


def draw_knee_tilt(seed: int, side: str) -> tuple[float, float]:
    """The turns of a knee's axis about x and y of the thigh, rad."""
    rng = stream(seed, "knee_axis", side)
    x, y = (float(np.radians(rng.normal(*spread))) for spread in KNEE_AXIS_DEG[side])
    return (x, y)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class VirtualSettings:
    """What is recorded, and how large its faults are (one: as in the literature, zero: none)."""

    placement: float = 1.0
    artefact: float = 1.0
    noise: float = 1.0
    gaps: float = 1.0
    image: float = 1.0
    """``placement``, ``artefact``, ``noise``, ``gaps``, ``image``: multiply the placement errors, skin
    movement, camera noise, the number of gaps and the errors of the image (markers and bone surfaces in
    it)."""
    rate_hz: float = 100.0
    functional_s: float = 10.0
    static_s: float = 2.0
    """``functional_s``, ``static_s``: length of each functional movement and of the standing trial."""
    gait_trials: int = 2
    strides: float = 2.5  # in each gait trial

    def __post_init__(self) -> None:
        shares = (self.placement, self.artefact, self.noise, self.gaps, self.image, self.gait_trials)
        lengths = (self.rate_hz, self.functional_s, self.static_s, self.strides)
        if min(shares) < 0.0 or min(lengths) <= 0.0:
            raise ValueError("sizes of faults are not negative, lengths and rates are positive")


@dataclasses.dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VirtualSubject:
    """A person of whom everything is known."""

    seed: int
    settings: VirtualSettings
    sex: Sex
    height_m: float
    mass_kg: float
    model: body.BodyModel  # the truth: true sizes, knee axes and marker places (skin at rest)
    generic: body.BodyModel  # what scaling starts from
    factors: Mapping[str, float]  # segment to its true size against the generic model
    tilts: Mapping[str, tuple[float, float]]
    """Knee to the true turns of its axis about x and y of the thigh, rad."""
    marker_offsets: Mapping[str, body.Vector]  # marker to its misplacement on the segment, m
    artefact: artefacts.Artefact  # how the skin moves
    motions: Mapping[str, Array]
    """Trial to the true coordinates, (n_frames, n_coordinates) in the model's order, rad or m."""
    trials: Mapping[str, Trial]
    """Trial to its recording: ``static``, ``hip_r``, ``hip_l``, ``knee_r``, ``knee_l``, ``gait_1`` and on."""


def make_virtual_subject(seed: int, settings: VirtualSettings = VirtualSettings()) -> VirtualSubject:
    """A person drawn from the literature's spread, and recorded.

    ``seed``: not negative. Equal seeds are the same person, whatever the settings.

    Every quantity has its own random stream, named after it: leaving one fault out changes no other.

    Examples
    --------
    >>> person = make_virtual_subject(1)
    >>> person.trials["hip_r"].markers.shape
    (1000, 14, 3)
    """
    generic = builtin.load_builtin(GENERIC)
    sex, height, mass = draw_person(seed)
    factors = draw_factors(seed, generic, height)
    tilts = {f"knee_{side}": draw_knee_tilt(seed, side) for side in KNEE_AXIS_DEG}
    offsets = {}
    for marker in generic.markers:
        if marker.weight > 0.0:
            spread = settings.placement * np.array(look_up_landmark_sd(marker.name))
            offsets[marker.name] = body.to_vector(
                spread * stream(seed, "placement", marker.name).normal(size=3)
            )
    model = _draw_truth(seed, generic, factors, tilts, offsets, mass)
    style = motion.draw_style(stream(seed, "style"), sex)
    motions = _simulate_motions(seed, model, style, height, settings)
    skin = artefacts.draw_artefact(seed, model, style.stance, settings.artefact)
    trials = {}
    for name, q in motions.items():
        labels = tuple(m.name for m in model.markers if m.weight > 0.0)
        times = np.arange(len(q)) / settings.rate_hz
        moving = artefacts.with_artefact(model, skin)
        markers = pose_markers(compile_model(moving, labels), q, list_parameter_values(moving))
        still = name == "static"
        noise = 1e-3 * settings.noise * CAMERA_MM["static" if still else "dynamic"]
        markers = markers + noise * stream(seed, "camera", name).normal(size=markers.shape)
        if not still:
            for k, label in enumerate(labels):
                markers[:, k] += artefacts.draw_residual(skin, stream(seed, "artefact", name, label), times)
                # Whether a marker is hidden in each frame, never in the first or last.
                rng = stream(seed, "gaps", name, label)
                hidden = np.zeros(len(times), dtype=bool)
                for _ in range(rng.poisson(settings.gaps * GAPS_PER_S * times[-1])):
                    start = rng.uniform(0.0, times[-1])
                    hidden |= (times >= start) & (times < start + rng.exponential(GAP_S))
                hidden[[0, -1]] = False
                markers[hidden, k] = np.nan
        trials[name] = Trial(name=name, times=times, labels=labels, markers=markers, rate_hz=settings.rate_hz)
    return VirtualSubject(
        seed=seed,
        settings=settings,
        sex=sex,
        height_m=height,
        mass_kg=mass,
        model=model,
        generic=generic,
        factors=factors,
        tilts=tilts,
        marker_offsets=offsets,
        artefact=skin,
        motions=motions,
        trials=trials,
    )


def make_session(person: VirtualSubject, model: body.BodyModel, trials: Mapping[str, Trial]) -> Session:
    """A person's trials as a session: functional movements fit, walking is held out."""
    name = f"virtual_{person.seed}"
    subject = Subject(
        id=name, model=GENERIC, sex=person.sex, height_m=person.height_m, mass_kg=person.mass_kg
    )
    return Session(
        subject=subject,
        model=model,
        static=trials["static"],
        calibration=tuple(t for name, t in trials.items() if name.startswith(("hip", "knee"))),
        evaluation=tuple(t for name, t in trials.items() if name.startswith("gait")),
    )


def process_recording(
    trial: Trial, model: body.BodyModel, settings: ProcessingSettings | None = None
) -> Trial:
    """A virtual recording after the usual smoothing and filling; its axes are right already."""
    clusters = {
        segment: tuple(m.name for m in model.markers if m.segment == segment and m.weight > 0.0)
        for segment in model.segment_names
    }
    return process(trial, Orientation(np.eye(3)), clusters, settings)


def _draw_truth(
    seed: int,
    generic: body.BodyModel,
    factors: Mapping[str, float],
    tilts: Mapping[str, tuple[float, float]],
    offsets: Mapping[str, body.Vector],
    mass: float,
) -> body.BodyModel:
    depicted = sum(s.mass for s in generic.segments) / builtin.load_generic_person(GENERIC).mass_kg
    model = scale_model(generic, {name: (f, f, f) for name, f in factors.items()}, mass_kg=mass * depicted)
    for joint in tilts:
        model = parameters.free_axis(model, joint, np.inf, np.inf)
    values = {
        f"axis.{joint}.{letter}": v
        for joint, turns in tilts.items()
        for letter, v in zip("xy", turns, strict=True)
    }
    markers = tuple(
        artefacts.shift_marker(m, offsets[m.name]) if m.name in offsets else m for m in model.markers
    )
    return dataclasses.replace(parameters.fold(model.with_markers(markers), values), name=f"virtual_{seed}")


def _simulate_motions(
    seed: int, model: body.BodyModel, style: motion.Style, height: float, settings: VirtualSettings
) -> dict[str, Array]:
    def clock(duration: float) -> Array:
        return np.arange(max(2, round(duration * settings.rate_hz))) / settings.rate_hz

    found = {
        "static": motion.simulate_standing(
            model, style, clock(settings.static_s), stream(seed, "static"), height
        )
    }
    for name, movement in (("hip", motion.simulate_hip_movement), ("knee", motion.simulate_knee_movement)):
        for side in motion.OTHER:
            rng = stream(seed, "motion", name, side)
            found[f"{name}_{side}"] = movement(model, style, side, clock(settings.functional_s), rng, height)
    for k in range(1, settings.gait_trials + 1):
        times = clock(settings.strides * style.stride_s)
        found[f"gait_{k}"] = motion.simulate_walking(
            model, style, times, stream(seed, "motion", "gait", k), height
        )
    return found
