"""What a calibration may do, with the paper's numbers as defaults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from scaling_service.model.parameters import KneeKind


@dataclass(frozen=True, slots=True)
class CalibrationSettings:
    """Settings of the optimisation-based methods (Puchaud 2019, section 2.2.4).

    Parameters
    ----------
    strategy : 'joint' or 'alternating'
        Motion and parameters together, or the paper's loop of inverse kinematics and parameters.
    n_frames : int
        Frames equally spaced over the calibration trials.
    length_bound : float
        Scale factors stay within ``1 +- length_bound`` of their start.
    axis_bound_x_deg, axis_bound_y_deg : float
        Bounds on the turns of a knee axis.
    marker_bound_m : float
        Bound on each shift of a marker's local coordinate.
    length_sd, axis_sd_deg, marker_sd_m : float
        Standard deviations of the prior around the first guess, for the ``joint`` strategy. Sizes: where
        the first guess has no deviation of its own, 5 %, which is what remains of a segment's length once
        stature is known (Puchaud 2019, table 2);
        axes moved by less than 5 deg there; marker shifts of MB_am were 12.3 (9.8) mm, which is
        9 mm along each axis. The paper's loop has no prior, but stops early.
    prior : bool
        Whether the prior is used.
    loop_tolerance : float
        The alternating loop stops when the cumulative kinematic error changes by less than this share.
    max_loops : int
        And at the latest after so many loops.
    robust_m : float, optional
        Scale of a Huber loss on marker distances; plain least squares if not given.
    sizes : 'weighted' or 'measured'
        Whether linear scaling weighs distances and anthropometry by their errors, or takes the plain mean of
        a segment's distances as the paper does and anthropometry only for what was not measured.
    hip_regression : str
        Which regression gives the person's hip centres for linear scaling (a name known to
        ``hip_centres``).
    hip_centre : 'regression' or 'functional'
        Whether the hip centres are predicted from the pelvis markers, or found where pelvis and
        thigh turn against each other in the calibration trials (SCoRE).
    knee_axis : 'epicondyles' or 'functional'
        Whether the knees' axes start along the epicondyles, or where thigh and shank turn against
        each other (SARA).
    scaling : 'uniform' or 'per-axis'
        One factor for each segment, as the paper has it, or factors along its axes where markers
        determine them.
    knee : 'hinge', 'universal' or 'spherical'
        The knees of a built-in leg model: flexion alone, as the paper has it, with inward rotation, or
        with varus and valgus as well.
    """

    strategy: Literal["joint", "alternating"] = "joint"
    n_frames: int = 100
    length_bound: float = 0.20
    axis_bound_x_deg: float = 20.0
    axis_bound_y_deg: float = 30.0
    marker_bound_m: float = 0.05
    length_sd: float = 0.05
    axis_sd_deg: float = 5.0
    marker_sd_m: float = 0.010
    prior: bool = True
    loop_tolerance: float = 0.01
    max_loops: int = 200
    robust_m: float | None = None
    sizes: Literal["weighted", "measured"] = "weighted"
    hip_regression: str = "harrington2007"
    hip_centre: Literal["regression", "functional"] = "regression"
    knee_axis: Literal["epicondyles", "functional"] = "epicondyles"
    scaling: Literal["uniform", "per-axis"] = "uniform"
    knee: KneeKind = "hinge"

    @property
    def uses_movements(self) -> bool:
        """Whether linear scaling looks at functional movements."""
        return self.hip_centre == "functional" or self.knee_axis == "functional"


PAPER = CalibrationSettings()
"""The settings of Puchaud 2019, with motion and parameters solved together."""
