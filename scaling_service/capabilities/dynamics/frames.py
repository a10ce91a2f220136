"""Which frames of a recording dynamics can be judged in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scaling_service.capabilities.dynamics.inverse_dynamics import InverseDynamics
from scaling_service.numerics.signals.filters import runs
from scaling_service.recording.plates_feet import FootContacts

EDGE_PERIODS = 0.5
"""Periods of the cutoff left out at both ends of what is known (chosen). There the filter leans on
mirrored data: in public walking trials the residual peaks at 90 to 240 N there, at 30 to 120 N elsewhere."""

FASTEST = 200.0
"""Angular acceleration of a filtered joint that is told, rad/s2 (chosen: 0.2 rad to and fro at 5 Hz; knees in
walking reach about 100). Markers that hardly determine a joint make it tremble so."""


def judged_frames(dynamics: InverseDynamics, contacts: FootContacts, cutoff_hz: float) -> NDArray[np.bool_]:
    """Frames with motion and all forces, away from the ends of what is known, shape (n,)."""
    known = dynamics.known
    edge = EDGE_PERIODS / cutoff_hz - 1e-9
    times = dynamics.motion.times
    inner = np.zeros_like(known)
    for start, stop in runs(known).tolist():
        span = times[start:stop]
        inner[start:stop] = (span - span[0] >= edge) & (span[-1] - span >= edge)
    return inner & contacts.supported


def trembling(dynamics: InverseDynamics, rotations: tuple[str, ...], frames: NDArray[np.bool_]) -> list[str]:
    """Coordinates that turn faster than joints do, largest first."""
    fastest = {
        name: float(np.abs(dynamics.motion.qddot[frames, k]).max())
        for k, name in enumerate(dynamics.coordinates)
        if name in rotations
    }
    return sorted((n for n, value in fastest.items() if value > FASTEST), key=lambda n: -fastest[n])
