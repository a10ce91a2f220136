"""Virtual persons of known body: skin slides and wanders, landmarks are palpated, and every bone is known."""

from __future__ import annotations

from collections import abc
from functools import partial
from pathlib import Path

import numpy as np

from scaling_service.files.sto import read_sto
from scaling_service.model.builtin import load_builtin
from scaling_service.model.trial import Trial
from scaling_service.studies.benchmark import parts, persons
from scaling_service.studies.benchmark.tasks import _legs

PERSONS = 12
"""Chosen: a mean error is then known to a fifth, in minutes."""

METHOD = "MAP"
"""Ours: the default answer."""

INTERVAL = 1.96  # standard deviations on each side of a normal distribution's 95 % interval


def make_cases(_data: Path, folder: Path, seed: int) -> abc.Sequence[parts.Case]:
    """Persons of a seed: standing, functional movements, and a walk that is judged."""
    cases = []
    markers = load_builtin(_legs.GENERIC).marker_names
    for k in range(PERSONS):
        person, box = persons.draw_person(1000 * (seed + 1) + k), folder / f"person_{k + 1:02d}"
        trials = [
            Trial(
                name=name,
                times=t,
                labels=tuple(at),
                markers=np.stack(list(at.values()), axis=1),
                rate_hz=persons.RATE_HZ,
            )
            for name, (t, at) in person.trials.items()
        ]
        clusters = {n: s for n, s in person.segments.items() if n not in markers}
        _legs.write_legs(box, trials, clusters)
        document = {
            "subject": {"id": box.name, "sex": person.sex, "height_m": round(person.height, 3)},
            "model": _legs.GENERIC,
            "extra_markers": clusters,
            "trials": {
                "static": "static.trc",
                "calibration": ["functional_r.trc", "functional_l.trc"],
                "evaluation": ["walk.trc"],
            },
        }
        _legs.write_subject(box, document)
        cases.append(
            parts.Case(
                name=box.name,
                judge=partial(judge_person, person),
                ours=partial(_legs.scale_by_ours, METHOD, box, "walk"),
                opensim=partial(_legs.scale_by_opensim, box, "walk"),
            )
        )
    return cases


def judge_person(person: persons.Person, answer: Path, _opensim: Path) -> abc.Mapping[str, float]:
    """Lengths between joints, where joints are in the walk, and its angles, against the person's own."""
    traced = parts.trace_model(answer / "model.osim", answer / "walk.mot")
    rows = parts.match_times(traced.times, person.trials["walk"][0])
    at = {name: traced.joint(name)[rows] for name in person.centres["walk"]}
    distance = {f"femur_{s}": at[f"hip_{s}"] - at[f"knee_{s}"] for s in "rl"}
    distance["inter_hip"] = at["hip_r"] - at["hip_l"]
    lengths = [np.linalg.norm(d, axis=1).mean() - person.lengths[name] for name, d in distance.items()]
    centres = [np.linalg.norm(at[name] - true, axis=1) for name, true in person.centres["walk"].items()]
    off = {}
    for name, true in person.angles["walk"].items():
        if name not in traced.coordinates:
            raise parts.NoAnswer(f"the model has no coordinate '{name}'")
        off[name] = parts.wrap(traced.coordinates[name][rows] - true)
    found = {
        "lengths": parts.MM * parts.rms(np.array(lengths)),
        "centres": parts.MM * parts.rms(np.array(centres)),
        "angles": float(np.degrees(parts.rms(np.array(list(off.values()))))),
    }
    deviations = answer / "walk_sd.mot"
    if deviations.is_file():
        table = read_sto(deviations)
        within = [np.abs(gap) <= INTERVAL * np.radians(table.column(name))[rows] for name, gap in off.items()]
        found["held"] = 100.0 * float(np.mean(within))
    return found
