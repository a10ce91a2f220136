"""A virtual person on two force plates, whose forces follow exactly from motion and inertia."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.files import sto
from scaling_service.files.trc import write_trc
from scaling_service.model import builtin, inertia
from scaling_service.model.body import BodyModel
from scaling_service.model.compile import compile_model, list_parameter_values, repeat_default_pose
from scaling_service.model.trial import Trial
from scaling_service.numerics.multibody.motion import Motion as Rates
from scaling_service.numerics.multibody.tree import pose_markers
from scaling_service.numerics.wrench import compute_root_wrench

RATE_HZ, SECONDS = 100.0, 2.5
"""Of one recording. Chosen: enough for a filter's run-in, and quick."""

MARKER_NOISE_M = 5e-4
"""Standard deviation of each coordinate of a marker (chosen: a good optical system's)."""

_STILL = ("pelvis", "hip", "knee", "ankle")
"""Coordinates that begin so stay where they are."""


@dataclass(frozen=True)
class Recorded:
    """A person who stands and swings trunk and arms, on two plates."""

    truth: BodyModel
    trial: Trial
    q: Array  # (n_frames, n_coordinates), rad and m
    plates: tuple[
        Array, Array
    ]  # right, left: (n_frames, 9), force N, point m, free moment N m, on the person


def record_on_plates(
    truth: BodyModel | None = None, *, name: str = "sway", seed: int = 0, noise_m: float = 0.0
) -> Recorded:
    """Markers and plates of one trial; the feet stand still, so that each one's plate is known.

    ``truth``: the person, with feet and inertia; the generic full body unless given. ``noise_m``: standard
    deviation of each coordinate of a marker.
    """
    model = truth or builtin.load_builtin("full_body_35dof")
    rng = np.random.default_rng(seed)
    times = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    q = repeat_default_pose(model, len(times))
    rates, curves = np.zeros_like(q), np.zeros_like(q)
    for k, coordinate in enumerate(model.coordinates):
        if not coordinate.name.startswith(_STILL):
            size, pace, phase = rng.uniform(0.03, 0.15), rng.uniform(3.0, 7.0), rng.uniform(0.0, 6.0)
            q[:, k] += size * np.sin(pace * times + phase)
            rates[:, k] = size * pace * np.cos(pace * times + phase)
            curves[:, k] = -size * pace**2 * np.sin(pace * times + phase)
    names = tuple(m.name for m in model.markers)
    markers = pose_markers(compile_model(model, names), q, list_parameter_values(model))
    wrench, _ = compute_root_wrench(
        inertia.compile_mechanism(model), Rates.of_frames(q, rates, curves), list_parameter_values(model)
    )
    feet = []
    for side in "RL":
        # Of a foot, on the ground, (3,)
        heel, toe = (markers[0, names.index(f"{side}{what}")] for what in ("HEE", "TOE"))
        feet.append(np.array([0.5 * (heel[0] + toe[0]), 0.0, 0.5 * (heel[2] + toe[2])]))
    # Two plates under the feet bear the wrench (n, 6) about the ground origin together.
    force, moment = wrench.T[:, :3], wrench.T[:, 3:]
    forward = moment[:, 2] / force[:, 1]
    share = (-moment[:, 0] / force[:, 1] - feet[1][2]) / (feet[0][2] - feet[1][2])
    points = [
        np.column_stack([forward, np.zeros_like(forward), np.full_like(forward, foot[2])]) for foot in feet
    ]
    forces = [share[:, None] * force, (1.0 - share)[:, None] * force]
    left_over = moment - sum(np.cross(p, f) for p, f in zip(points, forces, strict=True))
    free = np.zeros_like(force)
    free[:, 1] = 0.5 * left_over[:, 1]
    first, second = (np.column_stack([f, p, free]) for f, p in zip(forces, points, strict=True))
    seen = markers + rng.normal(0.0, noise_m, markers.shape)
    return Recorded(
        model, Trial(name=name, times=times, labels=names, markers=seen, rate_hz=RATE_HZ), q, (first, second)
    )


def write_forces(path: Path, times: Array, plates: tuple[Array, ...]) -> None:
    """Write plates as a force file, its columns named as OpenSim names them."""
    labels = [
        f"ground_force_{k + 1}_{what}{axis}" for k in range(len(plates)) for what in "vpm" for axis in "xyz"
    ]
    sto.write_sto(
        path, sto.Table(name=path.stem, columns=("time", *labels), data=np.column_stack([times, *plates]))
    )


def write_plates_example(folder: Path) -> dict[str, Any]:
    """Write two recordings with their forces, and ``subject.json`` that names them; returns the document."""
    names = ("sway", "swing")
    for seed, name in enumerate(names):
        found = record_on_plates(name=name, seed=seed, noise_m=MARKER_NOISE_M)
        write_trc(folder / f"{name}.trc", found.trial, "mm")
        write_forces(folder / f"{name}_grf.mot", found.trial.times, found.plates)
    person, mass_kg = builtin.load_generic_person("full_body_35dof"), round(inertia.sum_mass(found.truth), 3)
    document = {
        "subject": {"id": "plates", "sex": "M", "height_m": person.height_m, "mass_kg": mass_kg},
        "model": "full_body_35dof",
        "trials": {"calibration": ["sway.trc"], "evaluation": ["swing.trc"]},
        "forces": {f"{name}.trc": f"{name}_grf.mot" for name in names},
    }
    (folder / "subject.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    return document
