"""Several points of one name in a recording: the other recordings of the person tell which one it means."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from scaling_service.core.arrays import Array
from scaling_service.model.trial import Repair, Trial

_Kind = TypeVar("_Kind", bound=Trial)

_FRAMES = 50
"""Chosen: as many frames of a recording show how far two markers usually are from each other."""


def list_repeated(labels: Sequence[str]) -> dict[str, list[str]]:
    """Names that several points have to their further points, as they were told apart in reading.

    Examples
    --------
    >>> list_repeated(["RASI", "RKNE", "RASI#2", "RTH#1"])
    {'RASI': ['RASI#2']}
    """
    found: dict[str, list[str]] = {}
    for label in labels:
        name, mark, number = label.rpartition("#")
        if mark and number.isdigit() and name in labels:
            found.setdefault(name, []).append(label)
    return found


def choose_repeated(trials: Sequence[_Kind]) -> list[_Kind]:
    """Recordings of one person in which of the points of one name that one has it which lies as elsewhere.

    It is the point whose distances to all other markers are nearest to those of the name in the recordings
    where it stands once; where there are none the first in the file keeps the name. Exchanges are among
    the repairs.
    """
    repeated = [list_repeated(trial.labels) for trial in trials]
    asked = dict.fromkeys(name for twice in repeated for name in twice)
    usual: dict[str, dict[str, float]] = {name: {} for name in asked}
    for trial, twice in zip(trials, repeated, strict=True):
        sound = [k for k in trial.shown_labels if k not in twice and k.rpartition("#")[0] not in twice]
        for name in asked.keys() & set(sound):
            others = [label for label in sound if label != name]
            usual[name] = dict(zip(others, _measure(trial, name, others), strict=True)) | usual[name]
    chosen = []
    for trial, twice in zip(trials, repeated, strict=True):
        for name, further in twice.items():
            others = [o for o in trial.shown_labels if o in usual[name]]
            if not others:
                continue
            there = np.array([usual[name][o] for o in others])
            points = (name, *further)
            off = {p: np.median(np.abs(_measure(trial, p, others) - there)) for p in points}
            best = min(points, key=lambda point: (np.isnan(off[point]), off[point]))
            if best != name:
                exchanged = {name: best, best: name}
                detail = f"the point after it has the name: it lies as {name} does in the other recordings"
                note = Repair("duplicate", name, detail)
                trial = trial.relabel(exchanged).with_markers(trial.markers, note)
        chosen.append(trial)
    return chosen


def _measure(trial: Trial, one: str, others: Sequence[str]) -> Array:
    """The usual distances of a label from others, (n_others,), m; NaN where they are never seen together."""
    step = max(1, trial.n_frames // _FRAMES)
    theirs = trial.select(others).markers[::step]
    apart = np.linalg.norm(trial.position(one)[::step, None] - theirs, axis=2)
    usual = np.full(len(others), np.nan)
    known = np.isfinite(apart).any(axis=0)
    usual[known] = np.nanmedian(apart[:, known], axis=0)
    return usual
