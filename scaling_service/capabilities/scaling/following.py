"""What a scaled model makes of recordings: motions, errors and deviations of joint angles; its geometry."""

from __future__ import annotations

import time

import numpy as np

from scaling_service.capabilities.motion.inverse_kinematics import inverse_kinematics
from scaling_service.capabilities.motion.kinematic_error import kinematic_error
from scaling_service.capabilities.motion.run import track
from scaling_service.capabilities.scaling.comparison import geometry
from scaling_service.capabilities.scaling.result import Scaling
from scaling_service.core.arrays import Array
from scaling_service.core.progress import Progress
from scaling_service.model.results import Calibration, Motion
from scaling_service.model.subject import Session

FITTING = 0.6
"""Chosen: about the share of the fit in one method's time, before trials are followed."""


def follow_trials(calibration: Calibration, session: Session, part: Progress) -> Scaling:
    """The movements of a session as a calibrated model follows them; ``part``: progress of its method."""
    clock = time.perf_counter()
    motions: dict[str, Motion] = {}
    angle_sds: dict[str, dict[str, float]] = {}
    deviations: dict[str, Array] = {}
    trials = session.dynamic
    for k, trial in enumerate(trials):
        part(f"{calibration.method}: following {trial.name}", FITTING + (1.0 - FITTING) * k / len(trials))
        if calibration.model.posterior is None:
            motions[trial.name] = inverse_kinematics(calibration.model, trial)
            continue
        tracked = track(calibration.model, trial)
        motions[trial.name] = tracked.motion
        # Joint angle to its root mean square deviation over the frames that determine it, rad
        found = {}
        for name in geometry.list_joint_angles(calibration.model):
            sd = tracked.uncertainty.sd[:, tracked.motion.coordinates.index(name)]
            known = sd[np.isfinite(sd) & (sd > 0.0)]
            if len(known):
                found[name] = float(np.sqrt(np.mean(known**2)))
        angle_sds[trial.name] = found
        deviations[trial.name] = tracked.uncertainty.sd
    return Scaling(
        calibration=calibration,
        motions=motions,
        errors={name: kinematic_error(motion, calibration.model) for name, motion in motions.items()},
        geometry=geometry.measure_geometry(calibration),
        angle_sds=angle_sds,
        deviations=deviations,
        inverse_kinematics_s=time.perf_counter() - clock,
    )
