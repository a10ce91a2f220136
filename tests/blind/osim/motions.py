"""Real movements as OpenSim tracks them, and where the feet press in them; kept in a folder once tracked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scaling_service.files.sto import read_sto
from tests.blind.body import Array
from tests.blind.motions.motion import RATE_HZ, Motion, low_passed, rates
from tests.blind.motions.planted import Pressing
from tests.blind.osim.engine import read_body
from tests.peers.opensim_ik import run_opensim_ik

CUTOFF_HZ = 6.0
"""Of the coordinates: voluntary movement lies below (Winter 2009)."""

TRIMMED = 10
"""Frames at both ends, where the filter has less to go by."""

UNLOADED_N = 10.0
"""Less vertical force is nobody's foot (chosen: ten times the noise of the recordings used here)."""


@dataclass(frozen=True)
class Source:
    """A stretch of a real recording: files under the data folder, and its first and last second."""

    name: str
    trc: str
    mot: str
    span: tuple[float, float] | None = None
    but: tuple[str, ...] = ()

    def tracked(self, model: Path, data: Path, kept: Path) -> tuple[Motion, Pressing]:
        """Its motion with this model (rad, m), and the right foot's share and both centres of pressure."""
        file = kept / f"{self.name}.npz"
        if not file.is_file():
            weights = {m.name: 1.0 for m in read_body(model).markers if m.name not in self.but}
            ik = run_opensim_ik(model, data / self.trc, weights, time_range=self.span)
            order = [ik.coordinates.index(c) for c in read_body(model).coordinates]
            kept.mkdir(parents=True, exist_ok=True)
            np.savez(file, times=ik.times, q=ik.q[:, order])
        with np.load(file) as held:
            kept_frames = slice(TRIMMED, len(held["times"]) - TRIMMED)
            times, q = held["times"][kept_frames], low_passed(held["q"], CUTOFF_HZ)[kept_frames]
        clock = np.arange(len(times)) / RATE_HZ
        motion = Motion(self.name, clock, read_body(model).coordinates, *rates(clock, q))
        return motion, _pressing(data / self.mot, times, clock)


SOURCES = (
    Source("squats_a", "opencap_squat/squats1.trc", "opencap_squat/squats1_grf.mot", (0.0, 3.99)),
    Source("squats_b", "opencap_squat/squats1.trc", "opencap_squat/squats1_grf.mot", (5.0, 8.99)),
    Source("squats_c", "hidden/case_13/squatsAsym1.trc", "hidden/case_13/squatsAsym1_grf.mot", (0.0, 3.99)),
    Source("rising", "hidden/case_13/STSweakLegs1.trc", "hidden/case_13/STSweakLegs1_grf.mot"),
    Source("walking_a", "opencap_squat/walking1.trc", "opencap_squat/walking1_grf.mot"),
    Source("walking_b", "hidden/case_13/walking2.trc", "hidden/case_13/walking2_grf.mot"),
    Source("walking_c", "hidden/case_09/walkingTO1.trc", "hidden/case_09/walkingTO1_grf.mot"),
    Source(
        "walking_d", "hidden/case_01/walkingTI1.trc", "hidden/case_01/walkingTI1_grf.mot", but=("r_mankle",)
    ),
)
"""Of one person: ``opencap_squat``, and what OpenSim made of more of the same recordings, with no marker's or
pressed point's fault (in ``case_01`` one marker is late)."""


def _pressing(mot: Path, times: Array, clock: Array) -> Pressing:
    table = read_sto(mot)
    columns = dict(zip(table.columns, table.data.T, strict=True))
    force = np.stack([np.interp(times, table.times, columns[f"ground_force_{k}_vy"]) for k in (1, 2)], axis=1)
    loaded = force > UNLOADED_N
    points = np.zeros((len(times), 2, 3))
    for k in range(2):
        on = loaded[:, k]
        for axis, letter in ((0, "x"), (2, "z")):
            place = np.interp(times, table.times, columns[f"ground_force_{k + 1}_p{letter}"])
            points[:, k, axis] = np.interp(times, times[on], place[on])
    force = np.where(loaded, force, 0.0)
    return Pressing(clock, points, force[:, 0] / force.sum(axis=1))
