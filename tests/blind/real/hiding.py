"""What is hidden in the real recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.blind.body import Array
from tests.blind.real.squats import RealTrial

DELAY_S = 0.020
MOVED_MM = 5.0
RESTUCK_MM = 15.0
SCALE = 1.01
SWAP_S = (1.0, 2.5)


@dataclass(frozen=True)
class RealCase:
    """A change of some trials and the truth about it; ``change(trial, k)`` gives trial k as recorded."""

    name: str
    change: Callable[[RealTrial, int], RealTrial]
    hidden: tuple[dict[str, Any], ...]
    also: dict[str, Any] = field(default_factory=dict)


def _as_it_is(trial: RealTrial, k: int) -> RealTrial:
    return trial


def _withheld(trial: RealTrial, k: int) -> RealTrial:
    """Without the left foot's plate."""
    kept = [j for j, name in enumerate(trial.forces.columns) if not name.startswith("ground_force_2")]
    return trial.with_forces(tuple(trial.forces.columns[j] for j in kept), trial.forces.data[:, kept])


def _delayed(trial: RealTrial, k: int) -> RealTrial:
    """Now what was true 20 ms ago; the first samples are held."""
    data, times = trial.forces.data.copy(), trial.forces.times
    for j in range(1, data.shape[1]):
        data[:, j] = np.interp(times - DELAY_S, times, trial.forces.data[:, j])
    return trial.with_forces(trial.forces.columns, data)


def _moved(trial: RealTrial, k: int) -> RealTrial:
    """The right foot's plate lies 5 mm further forward than the file has it: its points lie 5 mm back."""
    data = trial.forces.data.copy()
    data[:, trial.plate("plate_1", "p")[0]] -= 1e-3 * MOVED_MM
    return trial.with_forces(trial.forces.columns, data)


def _swapped(trial: RealTrial, k: int) -> RealTrial:
    a, b = trial.markers.index("r_thigh1"), trial.markers.index("r_thigh2")
    times = trial.markers.times
    when = (times >= SWAP_S[0] - 1e-9) & (times <= SWAP_S[1] + 1e-9)
    positions = trial.markers.markers.copy()
    positions[when, a], positions[when, b] = trial.markers.markers[when, b], trial.markers.markers[when, a]
    return trial.with_positions(positions)


def _restuck(trial: RealTrial, k: int) -> RealTrial:
    """In the second and third trial a thigh marker is 15 mm nearer to its neighbour."""
    if k == 0:
        return trial
    positions = trial.markers.markers.copy()
    toward = positions[:, trial.markers.index("r_thigh3")] - positions[:, trial.markers.index("r_thigh1")]
    unit: Array = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    positions[:, trial.markers.index("r_thigh1")] += 1e-3 * RESTUCK_MM * unit
    return trial.with_positions(positions)


def _scaled(trial: RealTrial, k: int) -> RealTrial:
    return trial.with_positions(SCALE * trial.markers.markers)


def _truth(
    kind: str, where: list[str], parameters: dict[str, float], **more: Any
) -> tuple[dict[str, Any], ...]:
    common = {"driver": [], "also_where": [], "trials": None}
    return ({"kind": kind, "where": where, "parameters": parameters, **common, **more},)


CASES: tuple[RealCase, ...] = (
    RealCase("as_recorded", _as_it_is, ()),
    RealCase(
        "plate_withheld",
        _withheld,
        _truth("external_contact", ["calcn_l"], {}, also_where=["talus_l", "toes_l", "plate_2"]),
        {"compare_force": {"segment": "calcn_l", "plate": "plate_2"}},
    ),
    RealCase("forces_delayed", _delayed, _truth("force_delay", ["forces"], {"delay_s": DELAY_S})),
    RealCase(
        "plate_moved",
        _moved,
        _truth("plate_position", ["plate_1"], {"x_mm": MOVED_MM, "y_mm": 0.0, "z_mm": 0.0}),
    ),
    RealCase(
        "labels_swapped",
        _swapped,
        _truth("marker_swap", ["r_thigh1", "r_thigh2"], {"start_s": SWAP_S[0], "end_s": SWAP_S[1]}),
    ),
    RealCase("marker_moved", _restuck, _truth("marker_offset", ["r_thigh1"], {}, trials=[1, 2])),
    RealCase("volume_scaled", _scaled, _truth("capture_scale", ["markers"], {"factor": SCALE})),
)
