"""Hip centres and knee axes from functional movements, in the posture in which a person is measured.

The pose of every segment comes from its own markers, three or more; the hip centre is the point that pelvis
and thigh share (SCoRE), the knee axis the line that thigh and shank share (SARA). Everything is
expressed in ground in one posture, the standing one: the segments' poses are motions away from it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from scaling_service.capabilities.scaling.methods.posture import Cluster, Posture
from scaling_service.capabilities.subject.settings import CalibrationSettings
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.text import few
from scaling_service.model.trial import Trial
from scaling_service.numerics.geometry.functional import (
    Poses,
    joined,
    ranges_of_motion,
    rotation_axis,
    rotation_centre,
)
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.rigid import MIN_POINTS

HIP_RANGE_DEG = 20.0
"""About two directions, for a hip moved in one plane has a line of centres. The least range of motion for
which an accuracy was published (Ehrig 2006, abstract: 1.2 mm with 1 mm of noise on every marker)."""

KNEE_RANGE_DEG = 45.0
"""Half of the 90 deg at which axes were found within 1 mm (Ehrig 2007, abstract), chosen: the error of a
direction falls with the range, and from 45 deg on most methods agree on a centre (Ehrig 2006)."""

SHARPEST = 0.5
"""Chosen: ratio of the two smallest singular values beyond which no direction stands out as an axis."""


@dataclass(frozen=True, slots=True, eq=False)
class FunctionalJoints:
    """What functional movements say of a person's joints.

    Parameters
    ----------
    posture : Posture
        In which centres and axes are given.
    hips : mapping
        ``r`` or ``l`` to the hip centre, (3,), m, of the pelvis.
    knees : mapping
        ``r`` or ``l`` to the knee axis of the thigh, unit (3,), either way round.
    notes : tuple of str
        How each was found, and why others were not.
    """

    posture: Posture
    hips: Mapping[str, Array] = field(default_factory=dict)
    knees: Mapping[str, Array] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def hip_in(self, trial: Trial, side: str) -> Array:
        """A hip centre carried by the pelvis' markers through a trial, (n_frames, 3), m."""
        return self.posture.cluster("pelvis").poses(trial).place(self.hips[side])


class _NotFound(Exception):
    """Why a joint's centre or axis was not taken."""


def functional_joints(
    posture: Posture, trials: Sequence[Trial], settings: CalibrationSettings
) -> FunctionalJoints:
    """Hip centres and knee axes, those of them that the settings ask for.

    A side that its recordings do not determine is left out, with the reason among the notes.

    Parameters
    ----------
    trials : sequence of Trial
        Functional movements. For each joint those are used in which it moves enough.

    Raises
    ------
    TrialUnusable
        Nothing of what was asked for can be found on either side.
    """
    hips, of_hips = _both_sides("hip", posture, trials) if settings.hip_centre == "functional" else _NOTHING
    knees, of_knees = _both_sides("knee", posture, trials) if settings.knee_axis == "functional" else _NOTHING
    return FunctionalJoints(posture, hips, knees, (*of_hips, *of_knees))


def _both_sides(
    joint: Literal["hip", "knee"], posture: Posture, trials: Sequence[Trial]
) -> tuple[Mapping[str, Array], tuple[str, ...]]:
    """What is found by side, and how; refused where neither side gives anything."""
    find, what, instead = _SOUGHT[joint]
    found: dict[str, Array] = {}
    notes, reasons = list[str](), list[str]()
    for side in "rl":
        try:
            found[side], told = find(posture, trials, side)
            notes.append(f"MB: {joint}_{side}: {what} from {told}")
        except _NotFound as why:
            reasons.append(f"{joint}_{side}: {why}")
            notes.append(f"MB: {joint}_{side}: no {what}, {instead} in its place: {why}")
    if not found:
        raise TrialUnusable(
            f"no {what} of a {joint} can be found: {'; '.join(reasons)}",
            field="trials.calibration",
            remedy=f"Give functional movements of the {joint} and three markers on each segment "
            f"(`extra_markers:`), or take {instead}",
        )
    return found, tuple(notes)


def _hip(posture: Posture, trials: Sequence[Trial], side: str) -> tuple[Array, str]:
    limits = (HIP_RANGE_DEG, HIP_RANGE_DEG)
    used = _moving(posture, trials, "pelvis", f"femur_{side}", limits)
    found = rotation_centre(used.proximal, used.distal)
    return found.proximal, (
        f"{used.told}; both images of it lie {1e3 * found.rms:.1f} mm apart (RMS), "
        f"standard deviation at least {1e3 * found.sd:.1f} mm"
    )


def _knee(posture: Posture, trials: Sequence[Trial], side: str) -> tuple[Array, str]:
    used = _moving(posture, trials, f"femur_{side}", f"tibia_{side}", (KNEE_RANGE_DEG,))
    found = rotation_axis(used.proximal, used.distal)
    if not found.sharpness < SHARPEST:
        raise _NotFound(f"no axis stands out in {used.told}")
    return found.proximal, (
        f"{used.told}; its direction in thigh and shank differs by {np.degrees(found.spread):.1f} deg (RMS)"
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Moving:
    """Poses of both segments in the trials in which the joint moves enough."""

    proximal: Poses
    distal: Poses
    told: str


def _moving(
    posture: Posture, trials: Sequence[Trial], proximal: str, distal: str, limits_deg: Sequence[float]
) -> _Moving:
    clusters = [_enough(posture.cluster(segment), trials) for segment in (proximal, distal)]
    names, kept, best = [], [], np.zeros(len(limits_deg))
    for trial in trials:
        poses = clusters[0].poses(trial), clusters[1].poses(trial)
        turned = np.degrees(np.nan_to_num(ranges_of_motion(*poses)))[: len(limits_deg)]
        best = np.maximum(best, turned)
        if (turned >= limits_deg).all():
            used = int((poses[0].known & poses[1].known).sum())
            names.append(f"'{trial.name}' ({_angles(turned)}, {used} of {trial.n_frames} frames)")
            kept.append(poses)
    if not kept:
        raise _NotFound(
            f"it turns by at most {_angles(best)} in a calibration trial, "
            f"and {_angles(limits_deg)} are needed"
        )
    return _Moving(joined([p for p, _ in kept]), joined([d for _, d in kept]), few(names))


def _enough(cluster: Cluster, trials: Sequence[Trial]) -> Cluster:
    shown = cluster.shown(trials)
    if len(shown) < MIN_POINTS:
        names = f" ({', '.join(shown)})" if shown else ""
        raise _NotFound(
            f"{cluster.segment} carries {len(shown)} markers that the static trial (or its stand-in) and the "
            f"movements both show{names}, and its pose needs {MIN_POINTS}"
        )
    return cluster


def _angles(values_deg: Sequence[float] | Array) -> str:
    return f"{' and '.join(f'{v:.0f}' for v in values_deg)} deg"


_NOTHING: tuple[Mapping[str, Array], tuple[str, ...]] = (MappingProxyType({}), ())
_SOUGHT: Mapping[str, tuple[Callable[[Posture, Sequence[Trial], str], tuple[Array, str]], str, str]] = {
    "hip": (_hip, "functional centre", "the regression"),
    "knee": (_knee, "functional axis", "the epicondyles"),
}
"""How a joint is sought, what is sought, and what stands in where it is not found."""
