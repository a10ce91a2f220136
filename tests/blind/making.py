"""From a case to a subject's folder, and the truth about it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.blind.bodies import Person, lower_limb, person, whole_body
from tests.blind.body import Body
from tests.blind.cases import NAMEABLE, SIZES, Case
from tests.blind.clutter import NONE, NULLS, Clutter
from tests.blind.effects import EFFECTS
from tests.blind.files import write_c3d, write_mot, write_trc
from tests.blind.hidden import Effect, Hidden
from tests.blind.motions.free import free
from tests.blind.motions.motion import Motion
from tests.blind.motions.planted import Pressing, planted
from tests.blind.nameable import find_range
from tests.blind.opposed import against
from tests.blind.osim_file import write_osim
from tests.blind.real.angles import real_motion
from tests.blind.recording import Recording, record
from tests.blind.strangers import STRANGERS

STATIC = "standing_1"
"""Every person is recorded standing still, too."""

STATIC_S, MOVING_S = 3.0, 5.0
"""Length of the trials (chosen: as laboratories record them)."""


class NobodyMeetsError(ValueError):
    """A case cannot be made: twice what its recordings can name is more than laboratories meet."""


Trials = tuple[tuple[str, ...], tuple[str, ...]]


def trials(case: Case) -> Trials:
    """Calibration and evaluation trials of a case; a name's stem is its movement."""
    if case.movement == "gait":
        return ("gait_1", "gait_2"), ("gait_3",)
    if not case.forces:
        last = "jump" if case.seed % 2 else "squat"
        return ("hips_1", f"{last}_1", "gait_1"), ("hips_2", "gait_2")
    if case.seed % 2:
        return ("hips_1", "bounce_1", "gait_1"), ("squat_2", "gait_2")
    return ("squat_1", "shift_1", "gait_1"), ("bounce_2", "gait_2")


Drawn = tuple[Person, Body, tuple[Hidden, ...]]


def make(case: Case, subjects: Path, labels: Path) -> Path:
    """Write one case: its folder under ``subjects``, its truth as ``labels/<id>.json``.

    Returns
    -------
    Path
        The subject file.

    Raises
    ------
    NobodyMeetsError
        The case is of nameable size, and nobody meets that.
    """
    who, body, hidden = drawn(case)
    subject = _write(case, who, body, hidden, subjects / case.id)
    labels.mkdir(parents=True, exist_ok=True)
    text = json.dumps(_truth(case, body, hidden), indent=1)
    (labels / f"{case.id}.json").write_text(text, encoding="utf-8")
    return subject


def _write(case: Case, who: Person, body: Body, hidden: tuple[Hidden, ...], folder: Path) -> Path:
    """What the product is shown."""
    recordings = recorded(case, body, hidden)
    folder.mkdir(parents=True, exist_ok=True)
    write_osim(folder / "model.osim", body)
    files = {r.name: _written(folder, r, c3d=case.c3d) for r in recordings}
    subject, weight = folder / "subject.yaml", who.mass_kg + sum(thing.own_kg for thing in hidden)
    subject.write_text(yaml.safe_dump(_document(case, weight, who, files), sort_keys=False), encoding="utf-8")
    return subject


def drawn(case: Case) -> Drawn:
    """The person, the body that the model says, and what is hidden."""
    rng = stream(case, 0)
    who = person(rng)
    body = (whole_body if case.forces else lower_limb)(who)
    if case.group in {"null", "check"}:
        return who, body, ()
    effects = [_effect(kind) for kind in case.kinds]
    if case.size == NAMEABLE:
        return who, body, (_draw_nameable(case, effects[0], who, body),)
    size = SIZES.index(case.size)
    hidden = [effect.draw(body, effect.sizes[size] * _spread(rng), rng) for effect in effects]
    if case.group == "opposed":
        hidden[1] = against(hidden[0], hidden[1], body)
    return who, body, tuple(hidden)


def _draw_nameable(case: Case, effect: Effect, who: Person, body: Body) -> Hidden:
    """Twice to four times as large as it must be to be named; refused where nobody meets that."""

    def draw(size: float) -> Hidden:
        return effect.draw(body, size, stream(case, 3))

    sizes = find_range(effect, draw, lambda hidden, folder: _write(case, who, body, hidden, folder))
    if sizes is None:
        raise NobodyMeetsError(effect.kind, draw(effect.sizes[0]).where)
    return draw(float(np.exp(stream(case, 4).uniform(*np.log(sizes)))))


def recorded(
    case: Case, body: Body, hidden: tuple[Hidden, ...], clutter: Clutter | None = None
) -> list[Recording]:
    """All trials of a case; the clutter's noise is 0.7 to 1.4 times the usual where none is given."""
    clutter = clutter or _clutter(case)
    result = []
    for k, name in enumerate(_trial_names(case)):
        rng = stream(case, 2, k)
        motion, pressing = _motion(case, body, name, k, rng)
        here = tuple(h for h in hidden if h.trials is None or k in h.trials)
        result.append(record(body, motion, pressing, here, clutter, rng))
    return result


def _clutter(case: Case) -> Clutter:
    if case.group == "check":
        return NONE
    if case.group == "null":
        return NULLS[case.kinds[0]]
    return Clutter().scaled(float(stream(case, 1).uniform(0.7, 1.4)))


def _motion(
    case: Case, body: Body, name: str, k: int, rng: np.random.Generator
) -> tuple[Motion, Pressing | None]:
    kind, length = name.rsplit("_", 1)[0], STATIC_S if name == STATIC else MOVING_S
    if case.real and name != STATIC:
        return real_motion(k, name, rng, length), None
    return planted(kind, name, body, rng, length) if case.forces else (free(kind, name, rng, length), None)


def _effect(kind: str) -> Effect:
    return EFFECTS[kind] if kind in EFFECTS else STRANGERS[kind]


def _spread(rng: np.random.Generator) -> float:
    """Around the size, so that power can be seen as a curve (chosen: 0.75 to 1.35 times)."""
    return float(np.exp(rng.uniform(-0.3, 0.3)))


def stream(case: Case, *keys: int) -> np.random.Generator:
    """Depends on the case alone, not on the order of making."""
    return np.random.default_rng([int(case.id[5:], 16), *keys])


def _trial_names(case: Case) -> tuple[str, ...]:
    calibration, evaluation = trials(case)
    return (*calibration, *evaluation, STATIC)


def _written(folder: Path, recording: Recording, *, c3d: bool) -> tuple[str, str | None]:
    """The trial's file and its file of forces."""
    if c3d:
        write_c3d(folder / f"{recording.name}.c3d", recording)
        return f"{recording.name}.c3d", None
    write_trc(folder / f"{recording.name}.trc", recording)
    if recording.plates is None:
        return f"{recording.name}.trc", None
    write_mot(folder / f"{recording.name}_forces.mot", recording.plates)
    return f"{recording.name}.trc", f"{recording.name}_forces.mot"


def _document(
    case: Case, mass_kg: float, who: Person, files: dict[str, tuple[str, str | None]]
) -> dict[str, Any]:
    calibration, evaluation = trials(case)
    document: dict[str, Any] = {
        "subject": {"id": case.id, "height_m": round(who.height_m, 3), "mass_kg": round(mass_kg, 3)},
        "model": "model.osim",
        "trials": {
            "static": files[STATIC][0],
            "calibration": [files[name][0] for name in calibration],
            "evaluation": [files[name][0] for name in evaluation],
        },
    }
    forces = {trial: file for trial, file in files.values() if file is not None}
    return {**document, "forces": forces} if forces else document


def _truth(case: Case, body: Body, hidden: tuple[Hidden, ...]) -> dict[str, Any]:
    calibration, evaluation = trials(case)
    return {
        "id": case.id,
        "group": case.group,
        "kinds": list(case.kinds),
        "size": case.size,
        "movement": case.movement,
        "forces": case.forces,
        "c3d": case.c3d,
        "real": case.real,
        "seed": case.seed,
        "body_mass_kg": body.mass,
        "hidden": [thing.label() for thing in hidden],
        "calibration": list(calibration),
        "evaluation": list(evaluation),
    }
