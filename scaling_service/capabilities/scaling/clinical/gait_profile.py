"""The Gait Profile Score and its Movement Analysis Profile (Baker et al. 2009, Gait Posture 30:265)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
import yaml

from scaling_service.core.errors import InputError
from scaling_service.model.anatomy.conventional import PELVIS
from scaling_service.model.anatomy.frames import Side
from scaling_service.model.reference import reference_folder
from scaling_service.model.results import Array

VARIABLES = (
    "pelvis_anterior_tilt",
    "pelvis_obliquity_up",
    "pelvis_internal_rotation",
    "hip_flexion",
    "hip_adduction",
    "hip_internal_rotation",
    "knee_flexion",
    "ankle_dorsiflexion",
    "foot_internal_progression",
)
"""The nine angles of the score, in the order of the profile."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """One angle of a reference population over the gait cycle.

    Parameters
    ----------
    mean, sd : (n_nodes,), rad
        Equally spaced from 0 to 100 %; ``sd`` is between persons.
    """

    mean: Array
    sd: Array

    @property
    def typical(self) -> float:
        """RMS distance of the population's members from its mean, rad."""
        return float(np.sqrt(np.mean(self.sd**2)))


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The curves of a reference population.

    Parameters
    ----------
    source, population : str
    bands : mapping
        Angle to its band, all of one length.
    """

    source: str
    population: str
    bands: Mapping[str, Band]


@dataclass(frozen=True, slots=True)
class GaitProfile:
    """How far a gait is from the reference, for one person.

    Parameters
    ----------
    variable_scores : mapping
        Side to angle to its Gait Variable Score, rad: the Movement Analysis Profile.
    side_scores : mapping
        Side to its Gait Profile Score over nine variables, rad; a side that lacks one has none.
    score : float or None, rad
        Of both sides: six variables of each, and the pelvis' as in the cycles of the left (Baker 2009).
    """

    variable_scores: Mapping[Side, Mapping[str, float]]
    side_scores: Mapping[Side, float]
    score: float | None


@cache
def schwartz2008() -> Reference:
    """Walking at free speed of children and adolescents (Schwartz et al. 2008, J Biomech 41:1639)."""
    text = (reference_folder() / "gait_bands_schwartz2008.yaml").read_text(encoding="utf-8")
    document = yaml.safe_load(text)
    bands = {
        name: Band(np.radians(curve["mean"]), np.radians(curve["sd"]))
        for name, curve in document["curves"].items()
    }
    return Reference(document["source"], document["population"], bands)


def gait_variable_score(cycles: Array, mean: Array) -> float:
    """RMS difference from a reference's mean over the cycle, averaged over cycles.

    Parameters
    ----------
    cycles : (n_cycles, n_nodes), rad
        Cycles with NaN do not count.
    mean : (n_reference_nodes,), rad
        Every reference node is one of the cycles' nodes: 51 and 101, or equally many.

    Returns
    -------
    float, rad
        NaN without a cycle.

    Raises
    ------
    InputError
        Nodes that do not fall on each other.

    Examples
    --------
    >>> round(gait_variable_score(np.full((2, 101), 0.3), np.full(51, 0.2)), 9)
    0.1
    """
    step, rest = divmod(cycles.shape[1] - 1, len(mean) - 1)
    if rest or not step:
        raise InputError(
            f"a curve of {cycles.shape[1]} nodes has none at those of a reference of {len(mean)}",
            field="reference",
            remedy=f"Give curves of {len(mean)} nodes, or of a whole multiple of its intervals",
        )
    whole = cycles[np.isfinite(cycles).all(axis=1)]
    if not len(whole):
        return float("nan")
    return float(np.sqrt(np.mean((whole[:, ::step] - mean) ** 2, axis=1)).mean())


def gait_profile(curves: Mapping[Side, Mapping[str, Array]], reference: Reference) -> GaitProfile:
    """Scores of both sides.

    Parameters
    ----------
    curves : mapping
        Side to angle to its cycles, (n_cycles, n_nodes), rad. Sides, angles and cycles may be missing.
    reference : Reference
    """
    scores = {
        side: {
            name: gait_variable_score(angles[name], reference.bands[name].mean)
            for name in VARIABLES
            if name in angles and np.isfinite(angles[name]).all(axis=1).any()
        }
        for side, angles in curves.items()
    }
    complete = {side: by for side, by in scores.items() if len(by) == len(VARIABLES)}
    both = None
    if "r" in complete and "l" in complete:
        once = [score for name, score in complete["r"].items() if name not in PELVIS]
        both = _rms([*once, *complete["l"].values()])
    return GaitProfile(scores, {side: _rms(list(by.values())) for side, by in complete.items()}, both)


def typical_score(reference: Reference) -> float:
    """RMS distance of the reference's members from its mean over the nine variables, rad."""
    return _rms([reference.bands[name].typical for name in VARIABLES])


def _rms(scores: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(scores))))
