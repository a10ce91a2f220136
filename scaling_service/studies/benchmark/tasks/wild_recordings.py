"""One recording written in the ways that laboratories write it, and broken in the ways that they break it.

The answer must stay what it is for the plain files, or, where no right answer exists, be a refusal.
"""

from __future__ import annotations

import json
from collections import abc
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from scaling_service.core.errors import InputError
from scaling_service.files.trc import write_trc
from scaling_service.model.trial import Trial
from scaling_service.studies.benchmark import parts
from scaling_service.studies.benchmark.tasks import _legs, images

WITHIN_MM, WITHIN_DEG = 2.0, 1.0
"""Chosen: rounding and another smoothing move no more."""

PLAIN = "plain"
_FILES = {"static": "Static.c3d", "walking02": "Walking02.c3d"}


def _move(trial: Trial, matrix: abc.Sequence[abc.Sequence[float]]) -> Trial:
    return replace(trial, markers=trial.markers @ np.array(matrix, dtype=float).T)


def _without_pelvis(trial: Trial) -> Trial:
    kept = [k for k, label in enumerate(trial.labels) if "ASIS" not in label and "PSIS" not in label]
    return replace(trial, labels=tuple(trial.labels[k] for k in kept), markers=trial.markers[:, kept])


def _with_another_person(trial: Trial) -> Trial:
    other = trial.markers + np.array([1.5, 0.0, 0.0])
    labels = [f"{who}:{label}" for who in ("Anna", "Ben") for label in trial.labels]
    return replace(trial, labels=tuple(labels), markers=np.concatenate([trial.markers, other], axis=1))


def _prefix(trial: Trial) -> Trial:
    return replace(trial, labels=tuple(f"S01:{label}" for label in trial.labels))


def _rename(trial: Trial) -> Trial:
    own = {marker: label for label, marker in images.MARKERS.items()}
    return replace(trial, labels=tuple(own.get(label, label) for label in trial.labels))


def list_changes() -> abc.Mapping[str, tuple[abc.Callable[[Trial], Trial], bool]]:
    """What becomes of the markers, and whether there is an answer."""
    return {
        PLAIN: (lambda trial: trial, True),
        "z_up": (partial(_move, matrix=((1, 0, 0), (0, 0, -1), (0, 1, 0))), True),
        "turned": (partial(_move, matrix=((-1, 0, 0), (0, 1, 0), (0, 0, -1))), True),
        "prefix": (_prefix, True),
        "laboratory_names": (_rename, True),
        "mirrored_x": (partial(_move, matrix=((-1, 0, 0), (0, 1, 0), (0, 0, 1))), False),
        "mirrored_z": (partial(_move, matrix=((1, 0, 0), (0, 1, 0), (0, 0, -1))), False),
        "two_persons": (_with_another_person, False),
        "no_pelvis": (_without_pelvis, False),
    }


def _write_time_in_ms(text: str) -> str:
    head, rows = text.splitlines()[:6], [line.split("\t") for line in text.splitlines()[6:]]
    return "\n".join([*head, *("\t".join([r[0], f"{1e3 * float(r[1]):.3f}", *r[2:]]) for r in rows)]) + "\n"


def _miscount(text: str) -> str:
    lines = text.splitlines()
    counts = lines[2].split("\t")
    counts[2] = str(int(counts[2]) + 40)
    return "\n".join([*lines[:2], "\t".join(counts), *lines[3:]]) + "\n"


def list_texts() -> abc.Mapping[str, abc.Callable[[str], str]]:
    """How the plain files are written anew."""
    return {
        "crlf": lambda text: text.replace("\n", "\r\n"),
        "no_blank_line": lambda text: "\n".join(line for line in text.split("\n") if line.strip()) + "\n",
        "trailing_tabs": lambda text: "\n".join(f"{line}\t" if line else line for line in text.split("\n")),
        "frames_miscounted": _miscount,
        "time_in_ms": _write_time_in_ms,
    }


def make_cases(data: Path, folder: Path, _seed: int) -> abc.Sequence[parts.Case]:
    """Standing and walking of jia_mri, in every way; the scale tool's set-up and model stay the same."""
    trials = {name: images.take_markers(data / "jia_mri" / file) for name, file in _FILES.items()}
    cases = []
    changes, texts = list_changes(), list_texts()
    ways = [*changes, "metres", *texts]
    for way in ways:
        box = folder / way
        images.write_jia(data, box)
        change, answerable = changes.get(way, (changes[PLAIN][0], True))
        for name, trial in trials.items():
            path = box / f"{name}.trc"
            write_trc(path, change(trial), "m" if way == "metres" else "mm")
            if way in texts:
                path.write_bytes(texts[way](path.read_text(encoding="utf-8")).encode())
        _legs.write_subject(box, images.describe_jia())
        cases.append(
            parts.Case(
                name=way,
                judge=partial(judge_way, answerable),
                ours=partial(answer_or_refuse, partial(_legs.scale_by_ours, "MB", box, "walking02")),
                opensim=partial(answer_or_refuse, partial(_legs.scale_by_opensim, box, "walking02")),
            )
        )
    return cases


def answer_or_refuse(make: parts.Answer, answer: Path, run: parts.Run) -> None:
    """An answer, or that the files were refused."""
    try:
        make(answer, run)
    except (parts.ProgramFailed, InputError) as reason:
        (answer / "answer.json").write_text(json.dumps({"refused": str(reason)}), encoding="utf-8")


def judge_way(answerable: bool, answer: Path, _opensim: Path) -> abc.Mapping[str, float]:
    """The same femora and the same angles as of the plain files; or a refusal."""
    if not (answer / "walking02.mot").is_file():
        if "refused" not in parts.read_answer(answer):
            raise parts.NoAnswer("neither a motion nor a refusal")
        return {"wrong": 100.0 if answerable else 0.0}
    if not answerable:
        return {"wrong": 100.0}
    plain = answer.parent / PLAIN
    here, there = (parts.trace_model(f / "model.osim", f / "walking02.mot") for f in (answer, plain))
    if len(here.times) != len(there.times):
        return {"wrong": 100.0}
    gaps, angles = [], []
    for side in "rl":
        femora = [t.joint(f"hip_{side}")[0] - t.joint(f"knee_{side}")[0] for t in (here, there)]
        gaps.append(parts.MM * abs(np.linalg.norm(femora[0]) - np.linalg.norm(femora[1])))
        names = [n for n in there.coordinates if n.startswith(("hip", "knee")) and n.endswith(side)]
        angles += [
            np.degrees(parts.rms(parts.wrap(here.coordinates[n] - there.coordinates[n]))) for n in names
        ]
    return {"wrong": 0.0 if max(gaps) <= WITHIN_MM and max(angles) <= WITHIN_DEG else 100.0}
