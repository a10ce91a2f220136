"""Optimisation-based scaling: parameters that make the model follow the calibration movements.

Minimises the cumulative kinematic error over frames equally spaced in time (Puchaud 2019, eq. 1
and 2), either as the paper does, alternating inverse kinematics and parameters, or for motion and
parameters together, which reaches a minimum of both.
"""

from __future__ import annotations

import math
import time
from collections import abc
from dataclasses import dataclass
from types import MappingProxyType

from scaling_service.capabilities.scaling.methods import fitting
from scaling_service.capabilities.scaling.sizes import measurements
from scaling_service.capabilities.shared.settings import CalibrationSettings
from scaling_service.core.names import say_name, say_names, say_parameters
from scaling_service.core.text import list_few
from scaling_service.model import body, parameters, results
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.subject import Session
from scaling_service.numerics.least_squares import estimator
from scaling_service.numerics.least_squares.problem import Outcome, Solution

SELECTED_COORDINATES = {"PSIS": "xz", "ASIS": "xz", "LFE": "", "MFE": "xz", "FH": "xz", "LM": "", "MM": "x"}
"""Local coordinates that MB_lam frees, by landmark without its side (Puchaud 2019, table 1)."""

OTHER_COORDINATES = "xz"
"""For markers outside table 1. Chosen: as for most of its rows, never along the segment, where a shift
could not be told from a length."""

LEVEL_FOOT = {"all": "xz", "selected": "z"}
"""Of a foot that turns in two ways at the ankle: all but the heights in MB_am and EB_am, the breadth in
MB_lam, whose scale factor stands for x. Chosen: markers that may all turn about the ankle leave its angles
without a zero. On a recorded squat they drifted by 20 deg of dorsiflexion and inversion; with the heights
kept they did not, for 0.1 mm more of kinematic error (0.8 mm on the trial held out)."""

_FEET = ("calcn", "foot")

_DETERMINED = 1e-4  # share of a parameter's direction that may lie where the recording says nothing
_HALF = 0.5  # of the prior's variance: below it the recording has said more than the prior
_FAR = 3.0  # chosen: standard deviations of a size from which a fit contradicts what was measured
_UNIFORM = math.sqrt(12.0)  # range over standard deviation of a uniform distribution


@dataclass(frozen=True, slots=True)
class Freedom:
    """Whether segment lengths are free, and whether all marker coordinates are or only table 1's."""

    lengths: bool
    all_markers: bool

    def apply(
        self,
        model: body.BodyModel,
        seen: frozenset[str],
        settings: CalibrationSettings,
        length_sds: abc.Mapping[str, float] = MappingProxyType({}),
    ) -> body.BodyModel:
        """The model with its parameters freed.

        Only what the recordings can speak of is freed: markers that were seen, and sizes of
        segments that carry such markers.

        ``seen``: markers seen in the calibration frames.
        ``length_sds``: segment to the relative standard deviation of its size so far; else the settings
            decide.
        """
        carrying = {m.segment for m in model.markers if m.name in seen and m.weight > 0.0}
        if self.lengths:
            for segment in model.segments:
                if segment.name in carrying:
                    spread = (settings.length_bound, length_sds.get(segment.name, settings.length_sd))
                    axes = measurements.AXES.get(segment.name) if settings.scaling == "per-axis" else None
                    model = (
                        parameters.free_scale(model, segment.name, *spread)
                        if axes is None
                        else parameters.free_scale_axes(model, segment.name, axes, *spread)
                    )
        bounds = (math.radians(settings.axis_bound_x_deg), math.radians(settings.axis_bound_y_deg))
        for joint in find_tiltable_knees(model):
            model = parameters.free_axis(model, joint, *bounds, math.radians(settings.axis_sd_deg))
        # The feet that turn in two ways or more against their shank, in one joint
        level = frozenset(
            s.name
            for s in model.segments
            if model.bone_of(s.name).startswith(_FEET) and sum(j.turns for j in s.joints) > 1
        )
        for marker in model.markers:
            if marker.name in seen and marker.weight > 0.0:
                axes = "xyz" if self.all_markers else select_coordinates(marker.name)
                if marker.segment in level:
                    axes = LEVEL_FOOT["all" if self.all_markers else "selected"]
                if axes:
                    model = parameters.free_marker(
                        model, marker.name, axes, settings.marker_bound_m, settings.marker_sd_m
                    )
        return model


def select_coordinates(marker: str) -> str:
    """The local coordinates that MB_lam frees for a marker, whatever its alias."""
    landmark = find_canonical(marker)
    if landmark is None:
        return OTHER_COORDINATES
    return SELECTED_COORDINATES.get(landmark[1:], OTHER_COORDINATES)


def find_tiltable_knees(model: body.BodyModel) -> tuple[str, ...]:
    """The knees (joints to a tibia) whose axis says something: three free turns reach any orientation.

    Turns that are coupled to flexion are not free: their axes turn with the axis of flexion.
    """
    return tuple(s.joint_name for s in _list_shanks(model) if 0 < len(_list_turning_coordinates(s)) < 3)


def _list_shanks(model: body.BodyModel) -> list[body.Segment]:
    return [s for s in model.segments if model.bone_of(s.name).startswith("tibia")]


def _list_turning_coordinates(segment: body.Segment) -> set[str]:
    """The coordinates that turn a segment against its parent."""
    return {
        term.coordinate
        for joint in segment.joints
        if joint.kind == "rotation"
        for term in joint.law.terms
        if term.coordinate is not None
    }


def _list_warnings(
    method: str,
    estimated: abc.Sequence[results.EstimatedParameter],
    solution: Solution,
    doubt: estimator.Uncertainty,
    sds: abc.Mapping[str, float],
) -> tuple[str, ...]:
    found = []
    if solution.outcome is not Outcome.CONVERGED:
        found.append(f"{method}: stopped after {solution.steps} steps before it converged")
    bound = [p.name for p in estimated if p.at_bound]
    loose = [p.name for p in estimated if not p.identifiable]
    far = [
        f"{say_name(p.target)} ({100.0 * (p.value - 1.0):+.0f} %)"
        for p in estimated
        if p.group == "length" and abs(p.value - 1.0) > _FAR * sds.get(p.target, math.inf)
    ]
    if far:
        found.append(
            f"{method}: the movement pulls the size of {list_few(far)} more than {_FAR:.0f} standard "
            "deviations from what markers and stature say. Skin does so, or a joint that the model lacks: "
            "look at MB's"
        )
    if bound:
        found.append(
            f"{method}: {len(bound)} of {len(estimated)} parameters stopped at their bounds: "
            f"{list_few(say_parameters(bound, components=True))}"
        )
    if doubt.free_directions:
        found.append(
            f"{method}: {doubt.free_directions} combinations of parameters are not determined by these "
            f"recordings; the first guess decides them, so these mean little alone: "
            f"{list_few(say_parameters(loose, components=True))}"
        )
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Optimised:
    """Optimisation from another method's model."""

    name: str
    title: str
    needs: str
    freedom: Freedom
    needs_images: bool = False
    needs_movements: bool = True

    def _note_kept_knees(self, model: body.BodyModel) -> list[str]:
        """A note on knees whose axes the image gave and no movement turns."""
        kept = [s.joint_name for s in _list_shanks(model) if len(_list_turning_coordinates(s)) >= 3]
        if not kept or not self.needs_images:
            return []
        return [
            f"{self.name}: {say_names(kept)} turn freely in three ways, so no turn of their axes is fitted: "
            f"they stay as in {self.needs}"
        ]

    def calibrate(
        self,
        session: Session,
        start: results.Calibration | None,
        settings: CalibrationSettings,
        progress: fitting.Progress | None,
    ) -> results.Calibration:
        """Free what the method frees on the start's model, and fit it to the calibration trials.

        Raises TrialUnusable: no calibration trial shows a marker of the model.
        """
        assert start is not None
        clock = time.perf_counter()
        names = [m.name for m in start.model.markers if m.weight > 0.0]
        frames = fitting.choose_calibration_frames(session.calibration, names, settings.n_frames)
        shown = frozenset(frames.trial.shown_labels)
        weighted = settings.sizes == "weighted"
        sds = {name: size.sd for name, size in start.sizes.items()} if weighted else {}
        freed = self.freedom.apply(start.model, shown, settings, sds)
        fit_movement = fitting.fit_in_turn if settings.strategy == "alternating" else fitting.fit_together
        fitted = fit_movement(fitting.Fit.of(start.model, freed, frames, settings), settings, progress)
        fit, solution = fitted.fit, fitted.solution
        doubt = estimator.estimate_uncertainty(fit.problem, solution, fit.p0, fitted.variance)
        found = []
        for k, parameter in enumerate(freed.parameters):
            at_bound = bool(doubt.at_bound[k])
            spread = parameter.prior_sd or (parameter.upper - parameter.lower) / _UNIFORM
            telling = at_bound or doubt.sd[k] ** 2 < _HALF * spread**2
            known = bool(telling and doubt.undetermined[k] <= _DETERMINED)
            found.append(
                results.EstimatedParameter(
                    name=parameter.name,
                    value=float(solution.p[k]),
                    unit=parameter.unit,
                    sd=float(doubt.sd[k]),
                    at_bound=at_bound,
                    identifiable=known,
                    group=parameter.group,
                    target=parameter.target,
                )
            )
        estimated = tuple(found)
        values = {p.name: p.value for p in estimated}
        warnings = [*start.warnings, *self._note_kept_knees(start.model)]
        warnings += _list_warnings(self.name, estimated, solution, doubt, sds)
        factors = {}
        for segment in start.model.segment_names:
            x, y, z = start.scale_factors.get(segment, (1.0, 1.0, 1.0))
            kx, ky, kz = measurements.read_fitted_factor(values, segment)
            factors[segment] = (kx * x, ky * y, kz * z)
        tilts = {
            joint: (values.get(f"axis.{joint}.x", 0.0), values.get(f"axis.{joint}.y", 0.0))
            for joint in find_tiltable_knees(start.model)
        }
        turned = {
            joint: parameters.compose_tilts(start.axis_tilts.get(joint, (0.0, 0.0)), tilt)
            for joint, tilt in tilts.items()
        }
        return results.Calibration(
            method=self.name,
            model=parameters.fold(freed, values),
            generic=start.generic,
            scale_factors=factors,
            axis_tilts={**start.axis_tilts, **turned},
            parameters=estimated,
            cost=fit.error(solution),
            iterations=solution.steps,
            wall_s=time.perf_counter() - clock,
            warnings=tuple(warnings),
            image_poses=start.image_poses,
            sizes={} if self.freedom.lengths else start.sizes,
            bone_sized=start.bone_sized,
            joint_moves=start.joint_moves,
        )
