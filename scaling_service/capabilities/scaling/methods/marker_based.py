"""Marker-based linear scaling: one factor per segment from distances (MB, Puchaud 2019, 2.2.2)."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping

import numpy as np

from scaling_service.capabilities.scaling.methods import functional, people_prior, placement
from scaling_service.capabilities.scaling.sizes import points as sizes_points
from scaling_service.capabilities.scaling.sizes import sizing as personal_sizes
from scaling_service.capabilities.scaling.sizes.without_markers import size_without_markers
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core import errors
from scaling_service.core.text import list_few
from scaling_service.model import body, parameters, results, subject
from scaling_service.model import compile as compiling
from scaling_service.model.anatomy import lengths
from scaling_service.model.anatomy.centres import Centre
from scaling_service.model.anatomy.frames import build_pelvis_frame
from scaling_service.model.people import read_people
from scaling_service.model.places import tell_landmarks
from scaling_service.model.scaling import scale_model
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.tree import pose_markers

_SHORTEST_M = 0.01  # chosen: no two landmarks of a measurement lie closer on a person


def scale_linearly(
    session: subject.Session,
    settings: CalibrationSettings,
    bones: Mapping[str, float] = personal_sizes.NO_BONES,
) -> results.Calibration:
    """Scale the session's model from marker distances.

    With an OpenSim scale set-up its measurements, manual factors and marker placement are used; otherwise
    every segment's size is estimated from distances and anthropometry. Extra markers are then placed from the
    standing trial. Where the settings ask for it, hip centres and knee axes come from the functional
    movements; a side that these do not determine keeps regression and epicondyles, and a warning says why.

    ``bones``: dimension to the length that an image shows, m.
    Raises TrialUnusable: no recording, or none of the measurements can be taken, or no side's movements
        determine a joint that was asked for.
    Raises SubjectInvalid: a setting that is not for this kind of model.
    """
    clock = time.perf_counter()
    if session.unmarked:
        # The model of a person of whom there are rotations alone
        alone = size_without_markers(session)
        return results.Calibration(
            method="MB",
            model=scale_model(session.model, alone.factors),
            generic=session.model,
            scale_factors=dict(alone.factors),
            axis_tilts={},
            wall_s=time.perf_counter() - clock,
            warnings=alone.notes,
            sizes=alone.sizes,
            centres={},
        )
    standing = next((trial for trial in (session.static, *session.calibration) if trial is not None), None)
    if standing is None:
        raise errors.TrialUnusable(
            "there is no trial to measure lengths on",
            field="trials.static",
            remedy="Give a static trial or at least one calibration trial",
        )
    if settings.knee != "hinge":
        if session.subject.model.lower().endswith(".osim"):
            raise errors.SubjectInvalid(
                "an .osim model keeps its own knee",
                field="knee",
                remedy="Leave the knee as it is, or choose a built-in leg model",
            )
        session = dataclasses.replace(session, model=parameters.with_knee(session.model, settings.knee))
    notes: list[str] = []
    if session.static is None:
        notes.append(f"no static trial: lengths were measured on '{standing.name}'")
    setup = session.scale_setup
    joints = functional.find_functional_joints(session, settings)
    sizing: personal_sizes.Sizing | None = None
    if setup is not None:
        if settings.scaling != "uniform":
            raise errors.SubjectInvalid(
                "a scale set-up says itself along which axes it scales",
                field="scale_setup",
                remedy="Leave out either the set-up or the per-axis scaling",
            )
        factors = compute_setup_factors(session.model, standing, setup)
    else:
        sizing = personal_sizes.size_segments(session, settings, joints, bones)
        factors = dict(sizing.factors)
        notes.extend(sizing.notes)
    keep = setup is None or setup.preserve_mass_distribution
    model = scale_model(session.model, factors, preserve_mass_distribution=keep)
    tilts: dict[str, parameters.Tilt] = {}
    if joints is not None:
        model, tilts, more = _apply_functional(model, joints, session, settings)
        notes.extend(more)
    centres = {} if sizing is None else sizing.people[0].centres
    model, more = _with_markers(model, session, standing, centres)
    notes.extend(more)
    return results.Calibration(
        method="MB",
        model=model,
        generic=session.model,
        scale_factors=factors,
        axis_tilts=tilts,
        wall_s=time.perf_counter() - clock,
        warnings=tuple(notes),
        sizes={} if sizing is None else _widen_pelvis(model, sizing.sizes),
        centres={} if sizing is None else _state_hips(model, sizing),
    )


def _widen_pelvis(
    model: body.BodyModel, sizes: Mapping[str, results.SegmentSize]
) -> dict[str, results.SegmentSize]:
    """One factor sizes a pelvis by its spines, and hips lie apart from that as persons' do."""
    apart, people = lengths.measure_segment_lengths(model).get("inter_hip"), read_people()
    if apart is None:
        return dict(sizes)
    between = np.sqrt(2.0 * (1.0 + people.hip_sides)) * people.hip_sd[2] / apart  # both go outward alike
    return {
        segment: dataclasses.replace(size, sd=float(np.hypot(size.sd, between)))
        if size.dimension == "inter_hip"
        else size
        for segment, size in sizes.items()
    }


def _state_hips(model: body.BodyModel, sizing: personal_sizes.Sizing) -> dict[str, results.EstimatedCentre]:
    """How far the model's hips are from the person's: their distance from the estimate, and its deviation.

    Along x, y, z of the pelvis. Nothing without all four spines in model and recording.
    """
    spines, points = people_prior.find_spines(model, tell_landmarks(model)), sizing.people[0].points
    if spines is None or not spines.keys() <= points.keys():
        return {}
    own, seen = (build_pelvis_frame(*(at[name] for name in people_prior.SPINES)) for at in (spines, points))
    pelvis, found = lengths.find_segment(model, "pelvis", ""), {}
    for side in "rl":
        ends, name = lengths.find_joint_ends(model, "hip", side), f"hip_{side}"
        if pelvis in ends and name in points and name in sizing.centres:
            gap = np.nanmedian(seen.to_local(points[name]), axis=0) - own.to_local(ends[pelvis])[0]
            sd = np.hypot(gap, sizing.centres[name].sd)
            if np.isfinite(sd).all():
                found[name] = results.EstimatedCentre(sizing.centres[name].source, body.to_vector(sd))
    return found


def _with_markers(
    model: body.BodyModel, session: subject.Session, standing: Trial, centres: Mapping[str, Centre]
) -> tuple[body.BodyModel, tuple[str, ...]]:
    """Tracking and extra markers where the standing trial shows them.

    Landmarks that were not marked stand in as virtual ones while the model is posed for that, no longer.
    """
    setup, notes, posed = session.scale_setup, list[str](), standing
    if setup is not None and setup.placement is not None:
        model = placement.place_markers(model, standing, setup.placement)
    elif setup is None:
        model = sizes_points.with_sacrum(model, (standing, *session.dynamic))
        posed = sizes_points.with_virtual_landmarks(standing, centres)
        model, placed = placement.place_tracking_markers(model, posed)
        if placed:
            notes.append(
                f"MB: {len(placed)} tracking markers placed from '{standing.name}': {list_few(placed)}"
            )
    model, unposed = placement.add_markers(model, session.subject.extra_markers, posed)
    if unposed:
        notes.append(
            f"MB: {list_few(unposed)} left out: no landmark shows where the bones are that they move with; "
            "mark both ends of each in a standing trial, or map their labels under `markers:`"
        )
    return model, tuple(notes)


def _apply_functional(
    model: body.BodyModel,
    joints: functional.FunctionalJoints,
    session: subject.Session,
    settings: CalibrationSettings,
) -> tuple[body.BodyModel, dict[str, parameters.Tilt], tuple[str, ...]]:
    points = sizes_points.find_person_points(
        joints.posture.as_trial(),
        standing=session.static is not None,
        regression=settings.hip_regression,
        joints=joints,
    ).points
    model, tilts, doubts = functional.with_functional(model, joints, points, settings)
    return model, tilts, (*joints.notes, *doubts)


def compute_setup_factors(
    model: body.BodyModel, trial: Trial, setup: subject.ScaleSetup
) -> dict[str, body.Vector]:
    """Factors by an OpenSim scale set-up: the same as its ScaleTool gives.

    Raises TrialUnusable: a marker pair cannot be measured, or a length is zero.
    """
    factors = {s: [1.0, 1.0, 1.0] for s in model.segment_names}
    for step in setup.order:
        if step == "measurements":
            for measurement in setup.measurements:
                factor = _pair_factor(model, trial, measurement, setup.time_range)
                for segment, axes in measurement.axes.items():
                    for letter in axes if segment in factors else "":
                        factors[segment]["XYZ".index(letter)] = factor
        else:
            for segment, given in setup.manual.items():
                if segment in factors:
                    factors[segment] = list(given)
    return {s: (x, y, z) for s, (x, y, z) in factors.items()}


def _pair_factor(
    model: body.BodyModel,
    trial: Trial,
    measurement: subject.Measurement,
    time_range: tuple[float, float] | None,
) -> float:
    names = list(dict.fromkeys(name for pair in measurement.pairs for name in pair))
    for name in names:
        if name not in model.marker_names:
            raise errors.TrialUnusable(
                f"measurement '{measurement.name}' uses marker '{name}', which the model does not have",
                field="scale_setup",
                remedy="Give the marker set that belongs to the set-up under `marker_set:`",
            )
    tree = compiling.compile_model(model, names)
    ours = pose_markers(
        tree, compiling.repeat_default_pose(model, 1), compiling.list_parameter_values(model)
    )[0]
    rows = placement.select_frames(trial, time_range)
    ratios = []
    for first, second in measurement.pairs:
        seen = trial.position(first)[rows] - trial.position(second)[rows]
        person = float(np.nanmean(np.linalg.norm(seen, axis=1)))
        generic = float(np.linalg.norm(ours[names.index(first)] - ours[names.index(second)]))
        if min(person, generic) < _SHORTEST_M:
            raise errors.TrialUnusable(
                f"markers '{first}' and '{second}' lie less than {_SHORTEST_M * 1e3:.0f} mm apart",
                file=trial.name,
                field=f"scale_setup.{measurement.name}",
                remedy="Check the labels and the unit",
            )
        ratios.append(person / generic)
    return float(np.mean(ratios))


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class MarkerBased:
    """Linear scaling from marker distances."""

    title: str = "segment sizes from marker distances"
    needs: str | None = None
    needs_images: bool = False
    needs_movements: bool = False

    def calibrate(
        self,
        session: subject.Session,
        start: results.Calibration | None,  # noqa: ARG002 (all methods are called alike; this one needs no first guess)
        settings: CalibrationSettings,
        progress: object,  # noqa: ARG002 (one step: nothing to report)
    ) -> results.Calibration:
        """Scale the session's model from its standing trial."""
        return scale_linearly(session, settings)
