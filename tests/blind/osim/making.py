"""From a case to a subject's folder and its truth, in files that look like a laboratory's."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.blind.body import Array, Body
from tests.blind.cases import Case
from tests.blind.clutter import Clutter
from tests.blind.files import write_mot, write_trc
from tests.blind.forces import Plates
from tests.blind.making import stream
from tests.blind.motions.motion import RATE_HZ, Motion
from tests.blind.motions.planted import Pressing
from tests.blind.osim.cases import drawn
from tests.blind.osim.engine import OsimEngine, read_body, write_person
from tests.blind.osim.motions import SOURCES, Source
from tests.blind.recording import record

MODEL = "hidden/case_13/model.osim"
"""35 coordinates and 45 markers, of a person 1.68 m tall (AddBiomechanics, from ``opencap_squat``)."""

HEIGHT_M = 1.68
PERSONS = ((1.0, 62.6), (0.93, 50.3), (1.05, 81.0), (1.1, 74.9))
"""Size against that person, and mass, kg (chosen: body mass indices of 20 to 26)."""

MEASURED_MM = (0.5, 1.0)
"""Least and largest SD of the markers' noise (Vicon systems in motion; the upper end is conservative)."""

FORCE_N, POINT_M, FREE_MOMENT_NM = 1.0, 1e-3, 0.1
"""SD of each plate's readings (chosen: twice a good plate's data sheet)."""


class AlwaysOnPlates(Plates):
    """Plates whose readings are never cut off: an idle one shows its noise where the foot last was."""

    @property
    def loaded(self) -> Array:
        """Everywhere."""
        return np.full(self.force.shape[:2], True)


@dataclass(frozen=True)
class Noise(Clutter):
    """White or autocorrelated noise on markers; on plates of force, centre of pressure and free moment."""

    def on_plates(self, plates: Plates, rng: np.random.Generator) -> Plates:
        """Wrenches with noise."""
        points, shape = plates.pressed(), plates.force.shape
        for k in range(shape[1]):
            on = plates.loaded[:, k]
            for axis in range(3):
                points[:, k, axis] = np.interp(plates.times, plates.times[on], points[on, k, axis])
        free = np.zeros(shape)
        free[..., 1] = np.nan_to_num(plates.free_moment()) + FREE_MOMENT_NM * rng.normal(size=shape[:2])
        points[..., [0, 2]] += POINT_M * rng.normal(size=(*shape[:2], 2))
        force = plates.force + FORCE_N * rng.normal(size=shape)
        return AlwaysOnPlates(plates.times, force, free + np.cross(points, force))


def make(case: Case, bank: Path, data: Path) -> Path:
    """Write one case under ``bank``: ``subjects/<id>`` and ``labels/<id>.json``.

    Returns
    -------
    Path
        The subject file.
    """
    factor, mass_kg = PERSONS[case.seed % len(PERSONS)]
    folder = bank / "subjects" / case.id
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(_model(data, bank, factor, mass_kg), folder / "model.osim")
    body = read_body(folder / "model.osim")
    hidden = drawn(case, body, stream(case, 0))
    noise = _noise(case)
    sources = _sources(stream(case, 1))
    for k, source in enumerate(sources):
        motion, pressing = _grown(*source.tracked(data / MODEL, data, bank / "motions"), factor)
        here = tuple(h for h in hidden if h.trials is None or k in h.trials)
        recording = record(
            body, motion, pressing, here, noise, stream(case, 2, k), engine=OsimEngine, force_rate_hz=RATE_HZ
        )
        write_trc(folder / f"{source.name}.trc", recording)
        assert recording.plates is not None
        write_mot(folder / f"{source.name}_grf.mot", recording.plates)
    subject = folder / "subject.yaml"
    subject.write_text(yaml.safe_dump(_document(case, sources, factor, mass_kg), sort_keys=False))
    truth = {
        "id": case.id, "group": case.group, "kinds": list(case.kinds), "size": case.size,
        "movement": case.movement, "forces": True, "body_mass_kg": mass_kg,
        "hidden": [thing.label() for thing in hidden],
        "noise_left_mm": 1e3 * (noise.white_m + noise.slow_m) * _left(body),
    }  # fmt: skip
    (bank / "labels").mkdir(exist_ok=True)
    (bank / "labels" / f"{case.id}.json").write_text(json.dumps(truth, indent=1))
    return subject


def _left(body: Body) -> float:
    """RMS distance that noise of one SD leaves, once coordinates are fitted in each frame.

    A kneecap's coordinate follows the knee's.
    """
    free = sum(not c.endswith("_beta") for c in body.coordinates)
    return float(np.sqrt(3.0 - free / len(body.markers)))


def _model(data: Path, bank: Path, factor: float, mass_kg: float) -> Path:
    file = bank / "persons" / f"{factor:g}.osim"
    if not file.is_file():
        file.parent.mkdir(parents=True, exist_ok=True)
        write_person(data / MODEL, factor, mass_kg, file)
    return file


def _noise(case: Case) -> Noise:
    rng = stream(case, 3)
    sd = 1e-3 * float(rng.uniform(*MEASURED_MM))
    slow = case.kinds == ("autocorrelated",) or (case.group != "null" and rng.random() < 0.3)
    return Noise(white_m=0.0 if slow else sd, slow_m=sd if slow else 0.0, slow_s=0.03, skin_m=0.0, gaps=0)


def _sources(rng: np.random.Generator) -> tuple[Source, ...]:
    """A squat or rising, two walks, and one that is held out, in an order of chance."""
    still = [s for s in SOURCES if not s.name.startswith("walking")]
    walking = [s for s in SOURCES if s.name.startswith("walking")]
    chosen = [*rng.permutation(len(still))[:2]], [*rng.permutation(len(walking))[:2]]
    first, last = [still[k] for k in chosen[0]], [walking[k] for k in chosen[1]]
    return (first[0], last[0], first[1]) if rng.random() < 0.5 else (first[0], last[0], last[1])


def _grown(motion: Motion, pressing: Pressing, factor: float) -> tuple[Motion, Pressing]:
    """The same movement of a person ``factor`` times as tall."""
    slides = np.where(np.isin(motion.coordinates, ["pelvis_tx", "pelvis_ty", "pelvis_tz"]), factor, 1.0)
    q, qd, qdd = (x * slides for x in (motion.q, motion.qd, motion.qdd))
    return replace(motion, q=q, qd=qd, qdd=qdd), replace(pressing, points=factor * pressing.points)


def _document(case: Case, sources: tuple[Source, ...], factor: float, mass_kg: float) -> dict[str, Any]:
    files = [f"{s.name}.trc" for s in sources]
    return {
        "subject": {"id": case.id, "height_m": round(HEIGHT_M * factor, 3), "mass_kg": mass_kg},
        "model": "model.osim",
        "trials": {"calibration": files[:-1], "evaluation": files[-1:]},
        "forces": {f"{s.name}.trc": f"{s.name}_grf.mot" for s in sources},
    }
