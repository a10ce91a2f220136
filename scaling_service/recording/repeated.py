"""Several points of one name in a recording: the other recordings of the person tell which one it means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

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
    usual: dict[frozenset[str], float] = {}
    for trial in trials:
        twice = list_repeated(trial.labels)
        sound = [k for k in trial.shown_labels if k not in twice and k.rpartition("#")[0] not in twice]
        for k, label in enumerate(sound):
            for other in sound[k + 1 :]:
                usual.setdefault(frozenset((label, other)), _measure(trial, label, other))
    return [_choose(trial, usual) for trial in trials]


def _choose(trial: _Kind, usual: Mapping[frozenset[str], float]) -> _Kind:
    for name, further in list_repeated(trial.labels).items():
        others = [o for o in trial.shown_labels if frozenset((name, o)) in usual]
        if not others:
            continue
        off = {
            point: np.median([abs(_measure(trial, point, o) - usual[frozenset((name, o))]) for o in others])
            for point in (name, *further)
        }
        best = min(off, key=lambda point: (np.isnan(off[point]), off[point]))
        if best != name:
            exchanged = {name: best, best: name}
            detail = f"the point after it has the name: it lies as {name} does in the other recordings"
            trial = replace(
                trial,
                labels=tuple(exchanged.get(label, label) for label in trial.labels),
                repairs=(*trial.repairs, Repair(what="duplicate", where=name, detail=detail)),
            )
    return trial


def _measure(trial: Trial, one: str, other: str) -> float:
    step = max(1, trial.n_frames // _FRAMES)
    apart = np.linalg.norm((trial.position(one) - trial.position(other))[::step], axis=1)
    known = apart[np.isfinite(apart)]
    return float(np.median(known)) if len(known) else float("nan")
