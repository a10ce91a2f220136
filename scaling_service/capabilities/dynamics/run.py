"""Inverse dynamics of a subject's recordings, from the subject file to results and a verdict in memory."""

from __future__ import annotations

import time
from collections import abc
from dataclasses import dataclass
from html import escape
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics import start
from scaling_service.capabilities.dynamics import unmeasured as unweighed
from scaling_service.capabilities.dynamics import weight as weights
from scaling_service.capabilities.dynamics.inertia import identification
from scaling_service.capabilities.dynamics.inertia.evidence import ForceRecording
from scaling_service.capabilities.dynamics.inertia.parameters import InertialIdentification
from scaling_service.capabilities.dynamics.settings import DynamicsSettings
from scaling_service.capabilities.dynamics.uncertainty import total
from scaling_service.capabilities.kinetics import inverse_dynamics
from scaling_service.capabilities.kinetics.forces import TrialForces
from scaling_service.capabilities.shared import settings as shared_settings
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.core import progress as progressing
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.tables import ResultTable
from scaling_service.core.text import list_few
from scaling_service.model.results import Motion
from scaling_service.model.subject import Subject
from scaling_service.recording.faults import FAULTS

_PREPARING = 0.3
"""Chosen: about the share of reading, scaling and inverse kinematics; the uncertainty takes the rest."""

_WARNED_OF = (
    "two_feet", "two_plates", "in_swing", "no_plate", "no_foot", "pressure_astray", "force_sign",
    "not_recorded", *FAULTS,
)  # fmt: skip
"""Repairs of forces that a person should know of without opening the results."""

_WRONG_MASS = (
    "Give the right mass first: until then the residual is that of the mass, and says nothing else of "
    "the inertia or of the measurement."
)
_NOT_MEASURED = (
    "Inertial parameters are not to be calibrated by {}: the plates do not measure all that bears the "
    "person, or landings load them faster than the filter follows."
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrialDynamics:
    """One recording's dynamics."""

    motion: Motion  # as the markers have it, not filtered
    forces: TrialForces
    dynamics: inverse_dynamics.InverseDynamics
    frames: NDArray[np.bool_]  # (n,): those that count; see ``judged_frames``
    residuals: inverse_dynamics.Residuals  # over these frames
    recording: total.LoadedMotion  # the same, as its uncertainty is asked of it
    uncertainty: total.WrenchUncertainty  # of the residual, over the same frames
    # flight, and what bears the person that no plate measures
    unmeasured: tuple[unweighed.Unmeasured, ...] = ()
    warnings: tuple[str, ...] = ()  # plain sentences

    @property
    def calibration_supported(self) -> NDArray[np.bool_]:
        """Components (6,) whose residual inertia may be blamed for; none where plates do not measure all."""
        return np.asarray(self.uncertainty.calibration_supported & (not self.unmeasured))


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class DynamicsResults:
    """Dynamics of all of a subject's recordings that have forces."""

    prepared: start.Prepared
    chosen: DynamicsSettings
    settings: shared_settings.Settings
    trials: abc.Mapping[str, TrialDynamics]  # by the stems of the trials' files
    weight: weights.Weight  # by the plates, beside the model's
    verdict: str  # in plain words: what the residuals say of the model
    inertial: InertialIdentification | None = None  # where it was asked for and the verdict allows it
    warnings: tuple[str, ...] = ()  # what concerns all recordings
    wall_s: float = 0.0

    @property
    def residuals(self) -> ResultTable:
        """RMS of the residual wrench of every recording, N and N m."""
        units = [f"{name}_{'N' if name[0] == 'f' else 'Nm'}" for name in inverse_dynamics.COMPONENTS]
        rows = tuple((name, *map(float, trial.residuals.rms)) for name, trial in self.trials.items())
        return ResultTable("RMS of the residual", ("trial", *units), rows)

    @property
    def tables(self) -> dict[str, ResultTable]:
        """The residuals of all recordings."""
        return {"residuals": self.residuals}

    def __repr__(self) -> str:
        return f"{self.residuals!r}\n{self.verdict}"

    def _repr_html_(self) -> str:
        return f"{self.residuals._repr_html_()}<p>{escape(self.verdict)}</p>"


def dynamics(
    subject: Subject | str | Path,
    chosen: DynamicsSettings = DynamicsSettings(),
    settings: shared_settings.Settings = shared_settings.UNSMOOTHED,
    *,
    progress: progressing.Progress | None = None,
) -> DynamicsResults:
    """Joint forces and residuals of a subject's recordings, with their uncertainty (Muller et al. 2017).

    Parameters
    ----------
    subject : Subject or path
        A subject, or the subject file that describes it.
    chosen : DynamicsSettings
        Which scaling to start from, and what to do with the inertia.
    settings : Settings
        Markers are not smoothed unless it says so: motion and forces pass one filter.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    DynamicsResults
        Of every recording with forces: N and N m. ``verdict`` says what the residuals say of the model.

    Raises
    ------
    InputError
        Something in the subject file, the model, the recordings or their forces cannot be used.

    Examples
    --------
    >>> import scaling_service as ss
    >>> checked = ss.dynamics("plates/subject.json", ss.DynamicsSettings(start="none"))
    >>> checked.residuals.columns
    ('trial', 'fx_N', 'fy_N', 'fz_N', 'mx_Nm', 'my_Nm', 'mz_Nm')
    >>> round(checked.weight.plates_kg)
    67
    """
    clock = time.perf_counter()
    report = progress or progressing.show_nothing
    loaded = open_subject(subject, settings, facing=True)
    prepared = start.prepare(
        loaded, chosen, settings, progress=progressing.report_part(report, 0.0, _PREPARING)
    )
    trials: dict[str, TrialDynamics] = {}
    refused: dict[str, TrialUnusable] = {}
    with loaded.blame_files():
        for k, name in enumerate(prepared.motions):
            report(f"uncertainty of {name}", _PREPARING + (1.0 - _PREPARING) * k / len(prepared.motions))
            try:
                trials[name] = compute_trial_dynamics(prepared, name, chosen)
            except TrialUnusable as error:
                refused[name] = error
        if not trials:
            raise next(iter(refused.values()))
        weight = weights.weigh_motions(
            {name: (found.dynamics, found.frames) for name, found in trials.items()}
        )
        assert weight is not None  # a recording without a frame that counts is refused
        weight.check()
        inertial, notes = _identify(prepared, trials, chosen) if chosen.identify else (None, ())
    report("done", 1.0)
    return DynamicsResults(
        prepared=prepared,
        chosen=chosen,
        settings=settings,
        trials=trials,
        weight=weight,
        verdict=write_verdict(trials, weight, refused),
        inertial=inertial,
        warnings=(*prepared.warnings, *notes),
        wall_s=time.perf_counter() - clock,
    )


def _identify(
    prepared: start.Prepared, trials: abc.Mapping[str, TrialDynamics], chosen: DynamicsSettings
) -> tuple[InertialIdentification | None, tuple[str, ...]]:
    """Identify inertia from the calibration trials, and hold the evaluation trials out; None and why if not.

    A component of the wrench is used where the verdict supports it in one of the fitted trials. Where only
    evaluation trials have forces, the first of them is fitted.
    """
    fitted = [trial.name for trial in prepared.loaded.session.calibration if trial.name in trials]
    notes: tuple[str, ...] = ()
    if not fitted:
        fitted = [next(iter(trials))]
        notes = (f"no calibration trial has forces: inertia is identified from {fitted[0]}",)
    supported = np.any([trials[name].calibration_supported for name in fitted], axis=0)
    if not supported.any() and not chosen.despite_verdict:
        return None, (*notes, "inertia was not identified: the verdict is that it would fit noise")
    recordings = {name: ForceRecording(found.dynamics, found.frames) for name, found in trials.items()}
    result = identification.identify_inertia(
        prepared.model,
        [recordings[name] for name in fitted],
        held_out=[recording for name, recording in recordings.items() if name not in fitted],
        supported=supported,
        settings=identification.IdentificationSettings(
            mass_known=not chosen.free_mass,
            symmetric=not chosen.sides_apart,
            despite_verdict=chosen.despite_verdict,
        ),
    )
    return result, notes


def compute_trial_dynamics(prepared: start.Prepared, name: str, chosen: DynamicsSettings) -> TrialDynamics:
    """Inverse dynamics, residuals and their uncertainty of the recording of this stem."""
    motion, forces = prepared.motions[name], prepared.forces[name]
    found = inverse_dynamics.solve_inverse_dynamics(
        prepared.model, motion, forces.loads, cutoff_hz=chosen.cutoff_hz
    )
    unmeasured = unweighed.find_unmeasured(found, forces.contacts, prepared.model)
    frames = inverse_dynamics.find_judged_frames(found, forces.contacts, chosen.cutoff_hz)
    weight = weights.weigh_motions({name: (found, frames)}) if (frames & found.known).any() else None
    if weight is not None:
        weight.check()
    frames &= ~unweighed.find_unmeasured_frames(unmeasured, found.motion.times)
    if unmeasured and not (frames & found.known).any():
        raise TrialUnusable(
            f"the plates measure no frame of it whole: {'; '.join(one.sentence for one in unmeasured)}",
            file=name,
            field="forces",
            remedy="Give the forces of all plates, or record without a chair or a hold",
        )
    residuals = inverse_dynamics.evaluate_residuals(found, prepared.height_m, frames=frames)
    recording = total.LoadedMotion(
        model=prepared.model,
        motion=motion,
        loads=forces.loads,
        height_m=prepared.height_m,
        frames=frames,
        cutoff_hz=chosen.cutoff_hz,
    )
    said = _warn(forces, motion, inverse_dynamics.find_trembling(found, prepared.model, frames))
    warnings = tuple(f"{name}: {warning}" for warning in said)
    return TrialDynamics(
        motion=motion,
        forces=forces,
        dynamics=found,
        frames=frames,
        residuals=residuals,
        recording=recording,
        uncertainty=total.propagate(recording),
        unmeasured=unmeasured,
        warnings=warnings,
    )


def _warn(forces: TrialForces, motion: Motion, shaking: list[str]) -> abc.Iterator[str]:
    """What a person should know of a recording."""
    for repair in forces.repairs:
        if repair.what in _WARNED_OF:
            frames = f" ({repair.frames} frames)" if repair.frames else ""
            yield f"{repair.where}: {repair.detail}{frames}"
    still = [name for name in motion.coordinates if name not in motion.estimated]
    if still:
        yield f"no marker shows {list_few(still)}: they stand still, and what hangs on them moves as if stiff"
    if shaking:
        yield (
            f"{list_few(shaking)} tremble faster than joints do: markers hardly determine them, "
            "nor the residual"
        )


def write_verdict(
    trials: abc.Mapping[str, TrialDynamics],
    weight: weights.Weight,
    refused: abc.Mapping[str, TrialUnusable] = MappingProxyType({}),
) -> str:
    """What was left out; whether mass and plates are right, inertia is to be calibrated, limits are kept."""
    said = [
        f"In {name} {'; '.join(one.sentence for one in found.unmeasured)}."
        for name, found in trials.items()
        if found.unmeasured
    ]
    whole = {name: found for name, found in trials.items() if not found.unmeasured}
    if len(whole) < len(trials):
        said.append(_NOT_MEASURED.format(list_few([name for name in trials if name not in whole])))
    if weight.differs:
        said.append(_WRONG_MASS)
    elif whole:
        said.append(_judge_calibration(whole))
    left_out = (f"{name} is left out: {error.problem}." for name, error in refused.items())
    return " ".join([*weight.sentences, *left_out, *said, _describe_gates(trials)])


def _judge_calibration(trials: abc.Mapping[str, TrialDynamics]) -> str:
    if len(trials) == 1:
        return next(iter(trials.values())).uncertainty.verdict
    able: dict[str, list[str]] = {}
    for name, found in trials.items():
        components = ", ".join(np.array(inverse_dynamics.COMPONENTS)[found.calibration_supported])
        if components:
            able.setdefault(components, []).append(name)
    if not able:
        return (
            "None of these recordings can calibrate inertial parameters: in every component the "
            "measurement's own uncertainty explains all of the residual, and identification would fit noise."
        )
    by = "; ".join(f"{components} of {list_few(names)}" for components, names in able.items())
    return (
        f"Inertial parameters can be calibrated by {by}: there the residual stands above its uncertainty. "
        "Elsewhere the measurement's own uncertainty explains all of it."
    )


def _describe_gates(trials: abc.Mapping[str, TrialDynamics]) -> str:
    broken = {
        name: [
            gate.name
            for gate in found.residuals.gates
            if gate.source == inverse_dynamics.HICKS and not gate.passed
        ]
        for name, found in trials.items()
    }
    failing = [name for name, gates in broken.items() if gates]
    if not failing:
        return "The residuals keep the limits of Hicks et al. 2015."
    worst = max(failing, key=lambda name: len(broken[name]))
    limits = list_few(broken[worst])
    return f"The residuals break limits of Hicks et al. 2015 in {list_few(failing)} ({worst}: {limits})."
