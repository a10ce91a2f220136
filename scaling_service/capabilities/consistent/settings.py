"""What dynamically consistent inverse kinematics may do, and how large errors are expected to be."""

from __future__ import annotations

from dataclasses import dataclass

from scaling_service.capabilities.consistent.geometric import GeometryPrior
from scaling_service.capabilities.dynamics.settings import CUTOFF_HZ

SPREAD = GeometryPrior(0.05, 0.009)
"""5 % of a length, 9 mm of a marker's coordinate: the priors of the other calibrations."""


@dataclass(frozen=True, slots=True)
class ConsistentSettings:
    """Settings of the loop of motion, geometry and inertia (Futamure et al., fig. 2)."""

    # of the filter of the classical motion and of the forces (Muller et al. 2017, sec. 2.1; Futamure et al.
    # name none).
    cutoff_hz: float = CUTOFF_HZ
    # between knots of the joint angles. Chosen: 0.1 s lets pass up to 5 Hz, the cutoff.
    spacing_s: float = 0.1
    # expected error of a force in body weights. Chosen: 0.4 %, between the accuracy of a plate (AMTI, 0.1 %
    # of the load) and the residuals of walking (2 %; both Muller et al. 2017): a squat is slow, a body not
    # rigid.
    force_share: float = 0.004
    # expected error of a moment over that of a force. Chosen: 1 m, about the height of the centre of mass
    # over the ankles.
    arm_m: float = 1.0
    # residual_m, independent_s: what markers err beside the artefact that follows the joints: 2 to 3 mm RMS
    # below 2 Hz (as for virtual persons), so that errors are new after a quarter of a second
    residual_m: float = 0.0025
    independent_s: float = 0.25
    # standard deviation of what is wrong with a marker's place on its segment, each axis. Zero where the
    # model's markers were fitted to movements: the place is then known.
    placed_m: float = 0.0
    geometry_bound: float = 0.5  # lengths and coordinates stay within this share of their start (eq. 7)
    geometry_prior: GeometryPrior = SPREAD  # what holds them
    most_loops: int = 3  # chosen: Futamure et al. needed two
    # marker_resolution_m, force_resolution_n, moment_resolution_nm: the loop ends when RMS errors change by
    # less. Markers: Vicon's noise at rest, 0.2 mm. Forces: AMTI, 0.22 N (Muller et al. 2017). Moments: that
    # force at ``arm_m``.
    marker_resolution_m: float = 2e-4
    force_resolution_n: float = 0.22
    moment_resolution_nm: float = 0.22


PLAIN = ConsistentSettings()
"""Nothing chosen."""
