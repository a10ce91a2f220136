"""Functional hip centres and knee axes put into a scaled model of the built-in legs' kind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.scaling.methods.functional import FunctionalJoints, functional_joints
from scaling_service.capabilities.scaling.methods.joints import with_axis, with_centre
from scaling_service.capabilities.scaling.methods.posture import Posture
from scaling_service.capabilities.subject.settings import CalibrationSettings
from scaling_service.core.errors import SubjectInvalid
from scaling_service.model.anatomy.centres import Points
from scaling_service.model.anatomy.frames import femur_frame
from scaling_service.model.body import BodyModel, Vector
from scaling_service.model.parameters import Tilt, tilt_of
from scaling_service.model.poses import marker_position, model_values
from scaling_service.model.subject import Session
from scaling_service.numerics.multibody.laws import Array
from scaling_service.numerics.multibody.rigid import fit_rigid


def joints_of(session: Session, settings: CalibrationSettings) -> FunctionalJoints | None:
    """What the session's functional movements say, None where the settings do not ask for it.

    Raises
    ------
    SubjectInvalid
        The model is not of the built-in legs' kind: an ``.osim`` file keeps its own joints.
    TrialUnusable
        Nothing of what was asked for can be found.
    """
    if not settings.uses_movements:
        return None
    names = session.model.segment_names
    own_file = session.subject.model.lower().endswith(".osim")
    if own_file or not any({"pelvis", f"femur_{s}", f"tibia_{s}"} <= set(names) for s in "rl"):
        raise SubjectInvalid(
            "functional hip centres and knee axes are for built-in leg models: the joints of another model "
            "stay where it has them",
            field="model",
            remedy="Choose a built-in leg model, or take regression and epicondyles",
        )
    posture = Posture.of(session.model, session.subject.extra_markers, session.static, session.calibration)
    return functional_joints(posture, session.calibration, settings)


def with_functional(
    model: BodyModel, joints: FunctionalJoints, points: Points, settings: CalibrationSettings
) -> tuple[BodyModel, dict[str, Tilt], tuple[str, ...]]:
    """The scaled model with its joints where the movements have them.

    A hip centre is put where it lies among the pelvis' markers, fitted as inverse kinematics fits
    them. A knee axis is taken in the thigh's frame of the ISB, which is the built-in models'.

    Parameters
    ----------
    points : mapping
        Landmarks and hip centres in the posture, (1, 3) each, m.

    Returns
    -------
    model : BodyModel
    tilts : dict
        Knee to the turns of its axis about x and y of the thigh, rad.
    notes : tuple of str
        Axes that were not believed.
    """
    notes = []
    for side, centre in joints.hips.items():
        model = with_centre(model, f"femur_{side}", _in_pelvis(model, joints, centre))
    tilts: dict[str, Tilt] = {}
    for side, axis in joints.knees.items():
        joint = model.segment(f"tibia_{side}").joint_name
        tilt, doubt = _tilt(points, axis, side, settings)
        if tilt is None:
            notes.append(f"MB: {joint}: the epicondyles in its place: {doubt}")
        else:
            model, tilts[joint] = with_axis(model, joint, tilt), tilt
    return model, tilts, tuple(notes)


def _in_pelvis(model: BodyModel, joints: FunctionalJoints, centre: Array) -> Vector:
    cluster, values = joints.posture.cluster("pelvis"), model_values(model)
    known = [name for name in cluster.labels if name in model.marker_names]
    local = [marker_position(model.marker(name), values) for name in known]
    rotation, position = fit_rigid(np.array(local), np.array([joints.posture.points[n] for n in known]))
    x, y, z = (float(v) for v in rotation.T @ (centre - position))
    return (x, y, z)


def _tilt(points: Points, axis: Array, side: str, settings: CalibrationSettings) -> tuple[Tilt | None, str]:
    """The axis' turns about x and y of the thigh, or why it is not believed."""
    names = [f"hip_{side}", f"{side.upper()}LFE", f"{side.upper()}MFE"]
    missing = [name for name in names if name not in points or not np.isfinite(points[name]).all()]
    if missing:
        return None, f"{', '.join(missing)} not known in the posture, so the thigh has no frame"
    hip, lateral, medial = (points[name] for name in names)
    femur = femur_frame(hip, lateral, medial, "r" if side == "r" else "l")
    direction = femur.rotation[0].T @ axis
    tilt = tilt_of(direction if direction[2] > 0.0 else -direction)
    if _beyond(np.degrees(tilt), (settings.axis_bound_x_deg, settings.axis_bound_y_deg)):
        return None, (
            f"the functional axis is turned by {np.degrees(tilt[0]):.0f} deg about x and "
            f"{np.degrees(tilt[1]):.0f} deg about y, more than any person's"
        )
    return tilt, ""


def _beyond(degrees: Sequence[float] | Array, bounds: Sequence[float]) -> bool:
    return any(abs(angle) > bound for angle, bound in zip(degrees, bounds, strict=True))
