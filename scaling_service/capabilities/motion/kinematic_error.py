"""Kinematic error: how far a model's markers stay from the measured ones (Puchaud 2019, section 1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Motion


@dataclass(frozen=True, slots=True, kw_only=True)
class KinematicError:
    """Distances between measured and model markers over one trial, m."""

    # over all frames and markers in which a marker was seen (Puchaud 2019: "mean distance between
    # experimental and model markers over all the frames of a given trial")
    mean: float
    # standard deviation over the frames of each frame's mean distance: how steady the fit is in time. Chosen,
    # for the paper gives only the spread over subjects; population form, so one frame has 0.
    sd: float
    # rms, max: over the same distances as ``mean``
    rms: float
    max: float
    per_marker: Mapping[str, float]  # marker to its mean distance over the frames that show it
    # anatomical_mean, tracking_mean: as ``mean``, over the markers on bony landmarks and over those on soft
    # tissue; NaN where there is none
    anatomical_mean: float
    tracking_mean: float
    n_frames: int  # frames in which at least one marker was seen


def kinematic_error(motion: Motion, model: BodyModel) -> KinematicError:
    """The kinematic error of a motion (Puchaud et al. 2019, section 1).

    Parameters
    ----------
    motion : Motion
        From inverse kinematics; its markers are the ones compared.
    model : BodyModel
        The model that was moved.

    Returns
    -------
    KinematicError
        m.

    Raises
    ------
    KeyError
        The motion has a marker that the model has not.

    Examples
    --------
    >>> import scaling_service as ss
    >>> session = ss.scale("lab/subject.json", "MB").session
    >>> motion = ss.inverse_kinematics(session.model, session.evaluation[0])
    >>> error = ss.kinematic_error(motion, session.model)
    >>> error.mean <= error.rms <= error.max
    True

    By hand, 5 and 15 mm:

    >>> import numpy as np
    >>> from scaling_service.model.body import BodyModel, Marker, Segment
    >>> from scaling_service.model.results import Motion
    >>> box = Segment(name="box", parent="ground", joint_name="free", joints=())
    >>> marker = Marker.at("A", "box", (0.0, 0.0, 0.0))
    >>> model = BodyModel(name="one", segments=(box,), coordinates=(), markers=(marker,))
    >>> gaps = np.array([[[0.003, 0.004, 0.0]], [[0.0, 0.0, 0.015]]])
    >>> motion = Motion(
    ...     trial="walk", times=np.array([0.0, 0.01]), coordinates=(), q=np.zeros((2, 0)), markers=("A",),
    ...     residuals=gaps, estimated=(),
    ... )
    >>> error = ss.kinematic_error(motion, model)
    >>> round(error.mean, 6), round(error.sd, 6), round(error.max, 6)
    (0.01, 0.005, 0.015)
    """
    distances = motion.distances
    seen = np.isfinite(distances)
    # Whether a marker sits on a bony landmark; few OpenSim models say so, but the name may.
    anatomical = np.array(
        [(model.marker(name).anatomical or find_canonical(name) is not None) for name in motion.markers],
        dtype=bool,
    )
    counted = seen.any(axis=1)
    by_frame = np.nanmean(distances[counted], axis=1)
    return KinematicError(
        mean=_average_known(distances),
        sd=float(np.std(by_frame)) if counted.any() else float("nan"),
        rms=float(np.sqrt(_average_known(distances**2))),
        max=float(np.max(distances[seen], initial=0.0)) if seen.any() else float("nan"),
        per_marker={
            name: _average_known(distances[:, k]) for k, name in enumerate(motion.markers) if seen[:, k].any()
        },
        anatomical_mean=_average_known(distances[:, anatomical]),
        tracking_mean=_average_known(distances[:, ~anatomical]),
        n_frames=int(counted.sum()),
    )


def _average_known(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
