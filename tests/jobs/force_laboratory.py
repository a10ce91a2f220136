"""A laboratory with two force plates and a person of known inertia: what the plates show is exactly right."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from scaling_service.files.sto import Table, write_sto
from scaling_service.files.trc import write_trc
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import builtin
from scaling_service.model.compile import compile_model, default_coordinates, parameter_values
from scaling_service.model.inertia import mechanism_of, total_mass
from scaling_service.model.trial import Array, Trial
from scaling_service.numerics.multibody.motion import Motion as Rates
from scaling_service.numerics.multibody.tree import marker_positions
from scaling_service.numerics.wrench.ground_wrench import root_wrench

RATE_HZ, SECONDS = 100.0, 2.5
LEGS = ("pelvis", "hip", "knee", "ankle")


@dataclass(frozen=True)
class Recorded:
    """A person standing and swinging trunk and arms.

    ``plates`` has a row per plate of (n, 9): force, point, free moment, as files hold them.
    """

    truth: BodyModel
    trial: Trial
    q: Array
    plates: tuple[Array, Array]


def recorded(
    truth: BodyModel | None = None, *, name: str = "sway", seed: int = 0, noise_m: float = 0.0
) -> Recorded:
    """Markers and plates of one trial; the feet stand still, so that each one's plate is known."""
    model = truth or builtin("full_body_35dof")
    rng = np.random.default_rng(seed)
    times = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    q = default_coordinates(model, len(times))
    rates, curves = np.zeros_like(q), np.zeros_like(q)
    for k, coordinate in enumerate(model.coordinates):
        if not coordinate.name.startswith(LEGS):
            size, pace, phase = rng.uniform(0.03, 0.15), rng.uniform(3.0, 7.0), rng.uniform(0.0, 6.0)
            q[:, k] += size * np.sin(pace * times + phase)
            rates[:, k] = size * pace * np.cos(pace * times + phase)
            curves[:, k] = -size * pace**2 * np.sin(pace * times + phase)
    names = tuple(m.name for m in model.markers)
    markers = marker_positions(compile_model(model, names), q, parameter_values(model))
    wrench, _ = root_wrench(mechanism_of(model), Rates.of_frames(q, rates, curves), parameter_values(model))
    feet = [_middle(names, markers, side) for side in "RL"]
    plates = _shared(wrench.T, *feet)
    seen = markers + rng.normal(0.0, noise_m, markers.shape)
    return Recorded(model, Trial(name, times, names, seen, RATE_HZ), q, plates)


def _middle(names: tuple[str, ...], markers: Array, side: str) -> Array:
    heel, toe = (markers[0, names.index(f"{side}{what}")] for what in ("HEE", "TOE"))
    return np.array([0.5 * (heel[0] + toe[0]), 0.0, 0.5 * (heel[2] + toe[2])])


def _shared(wrench: Array, right: Array, left: Array) -> tuple[Array, Array]:
    """Two plates under the feet that bear a wrench (n, 6) about the ground origin together."""
    force, moment = wrench[:, :3], wrench[:, 3:]
    forward = moment[:, 2] / force[:, 1]
    share = (-moment[:, 0] / force[:, 1] - left[2]) / (right[2] - left[2])
    points = [
        np.column_stack([forward, np.zeros_like(forward), np.full_like(forward, p[2])]) for p in (right, left)
    ]
    forces = [share[:, None] * force, (1.0 - share)[:, None] * force]
    left_over = moment - sum(np.cross(p, f) for p, f in zip(points, forces, strict=True))
    free = np.column_stack([np.zeros((len(force), 1)), left_over[:, 1:2], np.zeros((len(force), 1))])
    first, second = (np.column_stack([f, p, 0.5 * free]) for f, p in zip(forces, points, strict=True))
    return first, second


def write_forces(path: Path, times: Array, plates: tuple[Array, ...]) -> None:
    """As OpenSim names them."""
    labels = [
        f"ground_force_{k + 1}_{what}{axis}" for k in range(len(plates)) for what in "vpm" for axis in "xyz"
    ]
    write_sto(path, Table(path.stem, ("time", *labels), np.column_stack([times, *plates])))


def document(**changes: Any) -> dict[str, Any]:
    """The laboratory's subject document, with top-level keys replaced."""
    mass = round(total_mass(builtin("full_body_35dof")), 3)
    return {
        "subject": {"id": "S01", "sex": "M", "height_m": 1.762, "mass_kg": mass},
        "model": "full_body_35dof",
        "trials": {"calibration": ["sway.trc"], "evaluation": ["swing.trc"]},
        "forces": {"sway.trc": "sway_grf.mot", "swing.trc": "swing_grf.mot"},
    } | changes


def write_subject(folder: Path, content: dict[str, Any]) -> Path:
    file = folder / "S01.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return file


def force_laboratory(folder: Path, *, truth: BodyModel | None = None, noise_m: float = 5e-4) -> Path:
    """Two recordings with their forces, and the subject file, in a folder; returns the subject file."""
    for seed, name in enumerate(("sway", "swing")):
        found = recorded(truth, name=name, seed=seed, noise_m=noise_m)
        write_trc(folder / f"{name}.trc", found.trial, "mm")
        write_forces(folder / f"{name}_grf.mot", found.trial.times, found.plates)
    return write_subject(folder, document())
