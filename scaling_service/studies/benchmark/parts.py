"""What a task of the benchmark consists of, and how answers are read."""

from __future__ import annotations

import json
import shutil
from collections import abc
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scaling_service.core.errors import InputError
from scaling_service.files.osim.models import ask

Array = NDArray[np.float64]

OURS, OPENSIM = "scaling-service", "OpenSim"
"""Entries that are made in every run."""

TIME_LIMIT_S = 900.0
"""Chosen: of one call of a program; the longest search on the given recordings takes a fifth."""

MM = 1e3


class NoAnswer(Exception):
    """An entry's folder holds nothing that could be judged; the text says why."""


class ProgramFailed(Exception):
    """Our program ended with an error; the text is what it said last."""


Run = abc.Callable[[abc.Sequence[object]], Path]
"""Runs our program with such words, and returns a new folder with its results, which goes in the end."""

Answer = abc.Callable[[Path, Run], None]
"""Writes an answer's files into a folder."""

Judge = abc.Callable[[Path, Path], abc.Mapping[str, float]]
"""The metrics of an answer in a folder, beside OpenSim's own folder for the case. Raises NoAnswer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One thing that is asked.

    ``opensim``: None where OpenSim has no tool for it.
    """

    name: str
    judge: Judge
    ours: Answer
    opensim: Answer | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric:
    """A figure of a task; less is better, but for ``held``, which should be 95 %."""

    key: str
    title: str
    digits: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Cases of one kind.

    ``needs``: folders of the data. ``cases``: makes the inputs of all cases in a folder; takes the data's
    folder, that folder and the run's seed. ``metrics``: the first ranks entries.
    """

    name: str
    title: str
    truth: str
    needs: abc.Sequence[str] = ()
    metrics: tuple[Metric, ...]
    cases: abc.Callable[[Path, Path, int], abc.Sequence[Case]]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Traced:
    """A model in motion, by OpenSim: SI and rad, frames first; see ``files.osim.tools.trace``."""

    times: Array
    coordinates: abc.Mapping[str, Array]
    slides: frozenset[str]
    joints: abc.Mapping[str, Array]
    markers: abc.Mapping[str, Array]
    turns: abc.Mapping[str, Array]

    def joint(self, name: str) -> Array:
        """A joint's places, (n, 3), m. Raises NoAnswer: the model has no such joint."""
        if name not in self.joints:
            raise NoAnswer(f"the model has no joint '{name}'; it has {', '.join(self.joints)}")
        return self.joints[name]


def trace_model(model: Path, motion: Path | None = None) -> Traced:
    """A model's poses in a motion, or its default pose. Raises NoAnswer: a file is absent or unreadable."""
    for file in (model, motion):
        if file is not None and not file.is_file():
            raise NoAnswer(f"{file.name} is absent")
    request = {"operation": "trace", "file": str(model.resolve())}
    try:
        found = ask(request | {"motion": motion and str(motion.resolve())}, time_limit_s=TIME_LIMIT_S)
    except InputError as error:
        raise NoAnswer(str(error)) from None
    tables = {
        part: {name: np.array(values, dtype=float) for name, values in found[part].items()}
        for part in ("coordinates", "joints", "markers", "turns")
    }
    return Traced(times=np.array(found["times"]), slides=frozenset(found["slides"]), **tables)


def ask_opensim(operation: str, file: Path, **request: Any) -> None:
    """Run one of OpenSim's tools on files; see ``files.osim.tools``."""
    paths = {k: str(v.resolve()) if isinstance(v, Path) else v for k, v in request.items()}
    ask({"operation": operation, "file": str(file.resolve()), **paths}, time_limit_s=TIME_LIMIT_S)


def read_answer(folder: Path, name: str = "answer.json") -> dict[str, Any]:
    """A JSON file of an answer. Raises NoAnswer: it is absent or no JSON object."""
    try:
        found = json.loads((folder / name).read_text(encoding="utf-8"))
    except OSError:
        raise NoAnswer(f"{name} is absent") from None
    except ValueError:
        raise NoAnswer(f"{name} is no JSON") from None
    if not isinstance(found, dict):
        raise NoAnswer(f"{name} is no JSON object")
    return found


def copy_inputs(files: abc.Iterable[Path], box: Path) -> Path:
    """Copy what is asked into a case's folder, and return the folder."""
    box.mkdir(parents=True, exist_ok=True)
    for file in files:
        shutil.copyfile(file, box / file.name)
    return box


def match_times(found: Array, wanted: Array) -> NDArray[np.intp]:
    """Rows of an answer at the times of the truth, s. Raises NoAnswer: times are missing."""
    if not len(found):
        raise NoAnswer("the motion has no frame")
    rows: NDArray[np.intp] = np.abs(found[None, :] - wanted[:, None]).argmin(axis=1)
    step = float(np.median(np.diff(wanted))) if len(wanted) > 1 else np.inf
    if np.abs(found[rows] - wanted).max() > 0.6 * step:
        raise NoAnswer("the motion does not cover the recording")
    return rows


def wrap(angles: Array) -> Array:
    """Angles between -pi and pi."""
    return (angles + np.pi) % (2.0 * np.pi) - np.pi


def rms(values: Array) -> float:
    """Root of the mean square, without what is not known."""
    return float(np.sqrt(np.nanmean(np.square(values))))
