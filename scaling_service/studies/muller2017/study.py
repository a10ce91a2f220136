"""The study of Muller et al. 2017 on virtual persons, whose true errors are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.identification import (
    IdentificationSettings,
    identify_inertia,
)
from scaling_service.capabilities.dynamics.inertia.parameters import PriorSpread
from scaling_service.capabilities.dynamics.inverse_dynamics import (
    InverseDynamics,
    dynamics_of,
    inverse_dynamics,
    rated_motion,
)
from scaling_service.capabilities.dynamics.residuals import residual_indicator
from scaling_service.capabilities.dynamics.uncertainty.linear import propagate_linearly
from scaling_service.capabilities.dynamics.uncertainty.markers import (
    FrameChoice,
    MarkerUncertainty,
    choose_frames,
    marker_uncertainty,
)
from scaling_service.capabilities.dynamics.uncertainty.total import (
    UncertaintySettings,
    WrenchUncertainty,
    blames_inertia,
    propagate,
)
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import inertias_of, total_mass, with_inertias
from scaling_service.numerics.multibody.laws import Array
from scaling_service.studies.muller2017.excitation import (
    WHOLE,
    ExcitationSettings,
    ExcitedPerson,
    Performance,
    excited_person,
)

SUBJECTS = 10
"""Muller et al. 2017, sec. 2.3."""

SOURCE = (
    "Muller A, Pontonnier C, Dumont G (2017) Uncertainty propagation in multibody human model dynamics. "
    "Multibody System Dynamics, Springer (hal-01462185)"
)

NOMINAL = 0.95
"""Rate at which a frame's interval by the markers' errors should hold the true error."""

INTERVAL = 1.96
"""Standard deviations of a Gaussian that hold ``NOMINAL`` of it."""

FREE = 10.0
"""How many times wider than usual the prior is where an identification trusts the residual (chosen: the
tables then hardly count; inertia stays physically possible)."""

DIFFERENCES = (
    "The persons are virtual: ten men of the paper's stature and mass, whose true inertia is off the "
    "regression's by what regressions miss. Skin glides with the joint angles; lengths and marker places are "
    "off by what a calibration leaves.",
    "Their movements are one sequence of a minute in which every joint moves. They are calmer than the "
    "paper's, and so are the model's errors: residuals and reconstruction error are smaller.",
    "The paper writes of noise of one size on all coordinates. One size cannot serve angles and metres; the "
    "root's position is left alone here. This was chosen after seeing both: with it, forces are three to six "
    "times as uncertain, the vertical one as much as the others, which is not what the paper shows.",
    "The share of a marker's error that its segment has in common is the same in the virtual skin and in the "
    "propagation of the markers' errors (0.75, from one study of knees). On real skin it may be another.",
    "R2 is that of a line without intercept. The stricter one about the mean is given beside.",
)
"""How this study is not the paper's, in plain English."""


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """What an identification did, as residual indicators (6,) before and after.

    ``fitted`` and ``held_out`` are residuals of the recordings; ``true`` is what the inertia leaves of the
    true motion and true forces of the held-out performance, which only a virtual person can tell.
    """

    fitted: tuple[Array, Array]
    held_out: tuple[Array, Array]
    true: tuple[Array, Array]

    @property
    def worse(self) -> float:
        """True error after over before, all components together."""
        before, after = self.true
        return float(np.sqrt((after**2).sum() / (before**2).sum()))


@dataclass(frozen=True, slots=True, eq=False)
class PersonStudied:
    """One person of the study."""

    name: str
    uncertainty: WrenchUncertainty  # Muller's, by Monte Carlo
    linear_slopes: Array  # (6,): the same slopes by linear propagation
    measurement: Array
    """(6,): indicator of the true error of the residual: what the same inertia leaves of the measured
    motion minus what it leaves of the true one."""
    inertial: Array  # (6,): indicator of what the table's inertia leaves of the true motion
    markers_sd: Array  # (6,): indicator of the standard deviation that the markers' errors give
    coverage: Array
    """(6,): share of frames whose true error lies within ``INTERVAL`` of these standard deviations."""
    markers: MarkerUncertainty
    choice: FrameChoice  # the ten best windows
    cautious: Held
    free: Held
    """``cautious``, ``free``: identified despite the verdict: beside the tables' prior, and with hardly
    any."""

    @property
    def supported_by_markers(self) -> NDArray[np.bool_]:
        """Components in which the markers' errors leave inertia to blame."""
        return blames_inertia(self.uncertainty.dr, self.markers_sd)

    @property
    def blamed(self) -> NDArray[np.bool_]:
        """Components in which the true inertial error exceeds the true error of the measurement."""
        return np.asarray(self.inertial > self.measurement)


def study_person(
    seed: int, settings: UncertaintySettings, recorded: ExcitationSettings = WHOLE
) -> PersonStudied:
    """The whole study of one person, in this thread.

    ``seed``: of the person. ``settings``: its seed is replaced by the person's.
    """
    person = excited_person(seed, recorded)
    performance = person.performances["in_order"]
    recording = performance.recording
    found = propagate(recording, replace(settings, seed=seed))
    linear = propagate_linearly(recording, settings.levels, settings.noise_on)
    markers = marker_uncertainty(recording)
    error, inertial = _true_errors(person, performance)
    rows, scale = markers.frames, _scale(person)
    sd = markers.sd
    within = np.abs(error[rows]) <= INTERVAL * sd
    return PersonStudied(
        f"excited_{seed}",
        found,
        linear.slopes_per_cm,
        np.asarray(_rms(error[rows]) / scale),
        np.asarray(_rms(inertial[rows]) / scale),
        np.asarray(_rms(sd) / scale),
        within.mean(axis=0),
        markers,
        choose_frames(recording, markers),
        _held(person, IdentificationSettings(despite_verdict=True)),
        _held(person, IdentificationSettings(spread=_wide(), despite_verdict=True)),
    )


def _wide() -> PriorSpread:
    usual = PriorSpread()
    return PriorSpread(FREE * usual.mass, FREE * usual.com, FREE * usual.length)


def _scale(person: ExcitedPerson) -> Array:
    return np.asarray(1.0 / residual_indicator(np.ones((1, 6)), total_mass(person.model), person.height_m))


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _true_errors(person: ExcitedPerson, performance: Performance) -> tuple[Array, Array]:
    """Residuals that the measurement and that the table's inertia bring, each (n, 6), N and N m."""
    table = with_inertias(person.truth, inertias_of(person.model))
    inertial = _true_residual(table, performance)
    return _measured(person.model, performance).residual - inertial, inertial


def _true_residual(model: BodyModel, performance: Performance) -> Array:
    """What a model's inertia leaves of the true motion and the true forces, (n, 6)."""
    rated = rated_motion(model, performance.times, performance.q, cutoff_hz=None)
    return dynamics_of(model, rated, performance.loads).residual


def _measured(model: BodyModel, performance: Performance) -> InverseDynamics:
    recording = performance.recording
    return inverse_dynamics(model, recording.motion, recording.loads)


def _held(person: ExcitedPerson, settings: IdentificationSettings) -> Held:
    """Identify from one performance, despite whatever verdict, and look at the other."""
    fit, other = person.performances["in_order"], person.performances["shuffled"]
    frames = fit.recording.frames
    found = identify_inertia(
        person.model, [ForceRecording(_measured(person.model, fit), frames)], settings=settings
    )
    pairs = (person.model, found.model)
    true = [with_inertias(person.truth, inertias_of(model)) for model in pairs]
    scale, inner = _scale(person), other.recording.frames

    def indicator(residual: Array) -> Array:
        return np.asarray(_rms(residual[inner]) / scale)

    fitted = [indicator(_measured(model, fit).residual) for model in pairs]
    held = [indicator(_measured(model, other).residual) for model in pairs]
    truth = [indicator(_true_residual(model, other)) for model in true]
    return Held((fitted[0], fitted[1]), (held[0], held[1]), (truth[0], truth[1]))
