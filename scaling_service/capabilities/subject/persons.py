"""Several persons in one recording: whose markers count."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

from scaling_service.core.errors import TrialUnusable
from scaling_service.core.text import list_few
from scaling_service.model import trial as trials
from scaling_service.model.anatomy import markers

_AnyTrial = TypeVar("_AnyTrial", bound=trials.Trial)

SHARED = 3
"""Chosen: as many labels that stand under two prefixes fix a segment; fewer are a slip of labelling."""


def select_person(trial: _AnyTrial, marker_map: Mapping[str, str]) -> _AnyTrial:
    """A recording without the labels of other persons.

    ``marker_map``: model marker to label, as the subject file says under ``markers:``; one label with its
    prefix there says whose recording it is. Raises TrialUnusable: there are several persons, and none or
    more than one is named.

    Examples
    --------
    >>> import numpy as np
    >>> labels = [f"{name}:{label}" for name in ("Anna", "Ben") for label in ("RASI", "LASI", "RKNE")]
    >>> markers = np.ones((1, 6, 3))
    >>> both = trials.Trial(name="a", times=np.zeros(1), labels=tuple(labels), markers=markers, rate_hz=1.0)
    >>> select_person(both, {"RASIS": "Ben:RASI"}).labels
    ('Ben:RASI', 'Ben:LASI', 'Ben:RKNE')
    """
    theirs: dict[str, dict[str, str]] = {}
    for label in trial.labels:
        theirs.setdefault(label.rpartition(":")[0], {})[markers.strip_prefix(label)] = label
    several = {prefix: labels for prefix, labels in theirs.items() if len(labels) >= SHARED}
    persons = {
        prefix: labels
        for prefix, labels in several.items()
        if any(
            len(labels.keys() & more.keys()) >= SHARED for other, more in several.items() if other != prefix
        )
    }
    if not persons:
        return trial
    named = {label.rpartition(":")[0] for label in marker_map.values() if label in trial.labels} & set(
        persons
    )
    names = list_few([f"'{prefix}'" if prefix else "no prefix" for prefix in persons])
    if len(named) != 1:
        prefix, labels = next(iter(persons.items()))
        known = [(markers.find_canonical(label), label) for label in labels.values()]
        marker, label = next(
            (pair for pair in known if pair[0]), (markers.strip_prefix(known[0][1]), known[0][1])
        )
        raise TrialUnusable(
            f"the recording holds {len(persons)} persons: the same labels stand under {names}",
            file=trial.name,
            field="markers",
            remedy="Say whose markers count by one label with its prefix under `markers:` in the subject "
            f"file, such as `{marker}: '{label}'`; or export each person alone",
        )
    (prefix,) = named
    gone = {label for other, labels in persons.items() if other != prefix for label in labels.values()}
    kept = [k for k, label in enumerate(trial.labels) if label not in gone]
    whose = f"'{prefix}'" if prefix else "no prefix"
    detail = f"the same labels stand under {names}; those of {whose} count, as the subject file says"
    return replace(
        trial,
        labels=tuple(trial.labels[k] for k in kept),
        markers=trial.markers[:, kept],
        repairs=(*trial.repairs, trials.Repair("persons", "labels", detail)),
    )
