"""Marker-based linear scaling: one factor per segment from distances (MB, Puchaud 2019, 2.2.2)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from scaling_service.calibration.axes import Tilt
from scaling_service.calibration.functional import FunctionalJoints
from scaling_service.calibration.functional_model import joints_of, with_functional
from scaling_service.calibration.measurements import MEASUREMENTS, ratio
from scaling_service.calibration.per_axis import per_axis
from scaling_service.calibration.placement import (
    add_markers,
    frames_around,
    place_markers,
    place_tracking_markers,
)
from scaling_service.calibration.points import model_points, person_points
from scaling_service.calibration.settings import CalibrationSettings
from scaling_service.core.errors import SubjectInvalid, TrialUnusable
from scaling_service.core.text import few
from scaling_service.kernels.tree import marker_positions
from scaling_service.models.body import BodyModel, Vector
from scaling_service.models.compile import compile_model, default_coordinates, parameter_values
from scaling_service.models.knees import with_knee
from scaling_service.models.results import Calibration
from scaling_service.models.scaling import scaled
from scaling_service.models.subject import Measurement, ScaleSetup, Session
from scaling_service.models.trial import Trial

_SMALLEST = 0.2  # chosen: a newborn is 0.29 of an adult's stature; beyond this a unit or a label is wrong
_SHORTEST_M = 0.01  # chosen: no two landmarks of a measurement lie closer on a person


def linear(session: Session, settings: CalibrationSettings) -> Calibration:
    """Scale the session's model from marker distances.

    With an OpenSim scale set-up its measurements, manual factors and marker placement are used;
    otherwise the measurements of :data:`~scaling_service.calibration.measurements.MEASUREMENTS`.
    Extra markers are then placed from the standing trial. Where the settings ask for it, hip centres
    and knee axes come from the functional movements; a side that these do not determine keeps
    regression and epicondyles, and a warning says why.

    Raises
    ------
    TrialUnusable
        No recording, or none of the measurements can be taken, or no side's movements determine a joint
        that was asked for.
    SubjectInvalid
        A setting that is not for this kind of model.
    """
    clock = time.perf_counter()
    standing = _standing(session)
    session = _with_knee(session, settings)
    notes: list[str] = []
    if session.static is None:
        notes.append(f"no static trial: lengths were measured on '{standing.name}'")
    setup = session.scale_setup
    joints = joints_of(session, settings)
    if setup is not None:
        _refuse_own_axes(settings)
        factors = setup_factors(session.model, standing, setup)
    else:
        factors, more = anatomical_factors(
            session.model, session.static, session.calibration, settings, joints
        )
        notes.extend(more)
    keep = setup is None or setup.preserve_mass_distribution
    model = scaled(session.model, factors, preserve_mass_distribution=keep)
    tilts: dict[str, Tilt] = {}
    if joints is not None:
        model, tilts, more = _functional(model, joints, session, settings)
        notes.extend(more)
    model, more = _with_markers(model, session, standing)
    notes.extend(more)
    return Calibration(
        "MB",
        model,
        session.model,
        factors,
        tilts,
        wall_s=time.perf_counter() - clock,
        warnings=tuple(notes),
    )


def _with_markers(model: BodyModel, session: Session, standing: Trial) -> tuple[BodyModel, tuple[str, ...]]:
    """Tracking and extra markers where the standing trial shows them."""
    setup, notes = session.scale_setup, list[str]()
    if setup is not None and setup.placement is not None:
        model = place_markers(model, standing, setup.placement)
    elif setup is None:
        model, placed = place_tracking_markers(model, standing)
        if placed:
            notes.append(f"MB: {len(placed)} tracking markers placed from '{standing.name}': {few(placed)}")
    return add_markers(model, session.subject.extra_markers, standing), tuple(notes)


def _functional(
    model: BodyModel, joints: FunctionalJoints, session: Session, settings: CalibrationSettings
) -> tuple[BodyModel, dict[str, Tilt], tuple[str, ...]]:
    points = person_points(
        joints.posture.as_trial(),
        standing=session.static is not None,
        regression=settings.hip_regression,
        joints=joints,
    )
    model, tilts, doubts = with_functional(model, joints, points, settings)
    return model, tilts, (*joints.notes, *doubts)


def _with_knee(session: Session, settings: CalibrationSettings) -> Session:
    if settings.knee == "hinge":
        return session
    if session.subject.model.lower().endswith(".osim"):
        raise SubjectInvalid(
            "an .osim model keeps its own knee",
            field="knee",
            remedy="Leave the knee as it is, or choose a built-in leg model",
        )
    return replace(session, model=with_knee(session.model, settings.knee))


def _refuse_own_axes(settings: CalibrationSettings) -> None:
    if settings.scaling != "uniform":
        raise SubjectInvalid(
            "a scale set-up says itself along which axes it scales",
            field="scale_setup",
            remedy="Leave out either the set-up or the per-axis scaling",
        )


def _standing(session: Session) -> Trial:
    for trial in (session.static, *session.calibration):
        if trial is not None:
            return trial
    raise TrialUnusable(
        "there is no trial to measure lengths on",
        field="trials.static",
        remedy="Give a static trial or at least one calibration trial",
    )


def anatomical_factors(
    model: BodyModel,
    standing: Trial | None,
    moving: Sequence[Trial],
    settings: CalibrationSettings,
    joints: FunctionalJoints | None = None,
) -> tuple[dict[str, Vector], tuple[str, ...]]:
    """Factors of each segment from anatomical landmarks: one, or one along each axis.

    Each measurement is taken on the first trial that shows all its points. Segments without a
    measurement take the mean factor of the others.

    Parameters
    ----------
    standing : Trial, optional
        The static trial; it is measured first.
    moving : sequence of Trial
        Measured where the static trial lacks a landmark.
    joints : FunctionalJoints, optional
        Hip centres that take the regression's place.

    Returns
    -------
    factors : dict
        Segment to x, y, z factors.
    notes : tuple of str
        What could not be measured.

    Raises
    ------
    TrialUnusable
        Nothing could be measured, or a length is zero.
    """
    ours = model_points(model)
    people = [
        person_points(trial, standing=trial is standing, regression=settings.hip_regression, joints=joints)
        for trial in ((standing, *moving) if standing is not None else moving)
    ]
    found: dict[str, float] = {}
    notes: list[str] = []
    for measurement in MEASUREMENTS:
        own = [s for s in measurement.segments if s in model.segment_names]
        taken = next((r for r in (ratio(measurement, p, ours) for p in people) if r is not None), None)
        if own and taken is not None:
            _check(taken.factor, own[0])
            found |= dict.fromkeys(own, taken.factor)
            if taken.pairs < len(measurement.pairs):
                notes.append(
                    f"MB: {', '.join(own)} measured on {taken.pairs} of {len(measurement.pairs)} distances"
                )
    if not found:
        raise TrialUnusable(
            "no segment could be measured: the landmarks of the pelvis, knees and ankles are not all there",
            field="markers",
            remedy="Map the labels of ASIS, PSIS, epicondyles and malleoli under `markers:`",
        )
    mean = float(np.mean(list(found.values())))
    rest = [s for s in model.segment_names if s not in found]
    if rest:
        notes.append(f"MB: no landmarks to measure {', '.join(rest)}: scaled by the mean factor {mean:.3f}")
    every = {s: found.get(s, mean) for s in model.segment_names}
    factors: dict[str, Vector] = {s: (f, f, f) for s, f in every.items()}
    if settings.scaling == "per-axis":
        factors, more = per_axis(factors, people, ours)
        notes.extend(more)
        for segment, along in factors.items():
            for factor in along:
                _check(factor, segment)
    return factors, tuple(notes)


def _check(factor: float, segment: str) -> None:
    if not _SMALLEST < factor < 1.0 / _SMALLEST:
        raise TrialUnusable(
            f"segment '{segment}' would be scaled by {factor:.3g}",
            field="markers",
            remedy="Check the unit of the recording and that the labels mean the right landmarks",
        )


def setup_factors(model: BodyModel, trial: Trial, setup: ScaleSetup) -> dict[str, Vector]:
    """Factors by an OpenSim scale set-up: the same as its ScaleTool gives.

    Raises
    ------
    TrialUnusable
        A marker pair cannot be measured, or a length is zero.
    """
    factors = {s: [1.0, 1.0, 1.0] for s in model.segment_names}
    for step in setup.order:
        if step == "measurements":
            for measurement in setup.measurements:
                _apply(measurement, _pair_factor(model, trial, measurement, setup.time_range), factors)
        else:
            for segment, given in setup.manual.items():
                if segment in factors:
                    factors[segment] = list(given)
    return {s: (x, y, z) for s, (x, y, z) in factors.items()}


def _apply(measurement: Measurement, factor: float, factors: Mapping[str, list[float]]) -> None:
    for segment, axes in measurement.axes.items():
        for letter in axes if segment in factors else "":
            factors[segment]["XYZ".index(letter)] = factor


def _pair_factor(
    model: BodyModel, trial: Trial, measurement: Measurement, time_range: tuple[float, float] | None
) -> float:
    names = list(dict.fromkeys(name for pair in measurement.pairs for name in pair))
    for name in names:
        if name not in model.marker_names:
            raise TrialUnusable(
                f"measurement '{measurement.name}' uses marker '{name}', which the model does not have",
                field="scale_setup",
                remedy="Give the marker set that belongs to the set-up under `marker_set:`",
            )
    tree = compile_model(model, names)
    ours = marker_positions(tree, default_coordinates(model, 1), parameter_values(model))[0]
    rows = frames_around(trial, time_range)
    ratios = []
    for first, second in measurement.pairs:
        seen = trial.position(first)[rows] - trial.position(second)[rows]
        person = float(np.nanmean(np.linalg.norm(seen, axis=1)))
        generic = float(np.linalg.norm(ours[names.index(first)] - ours[names.index(second)]))
        if min(person, generic) < _SHORTEST_M:
            raise TrialUnusable(
                f"markers '{first}' and '{second}' lie less than {_SHORTEST_M * 1e3:.0f} mm apart",
                file=trial.name,
                field=f"scale_setup.{measurement.name}",
                remedy="Check the labels and the unit",
            )
        ratios.append(person / generic)
    return float(np.mean(ratios))
