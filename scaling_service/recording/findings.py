"""What recordings show that a sound person does not, as values, and what the questions are put to."""

from __future__ import annotations

import dataclasses
from collections import abc

from scaling_service.core.errors import TrialUnusable
from scaling_service.core.notes import Note
from scaling_service.model.anatomy.markers import find_canonical
from scaling_service.model.body import BodyModel
from scaling_service.model.inertia import Sex
from scaling_service.model.trial import Trial
from scaling_service.recording import exchanged

BEYOND_DOUBT = 1e3
"""Odds against a sound recording, priors included, from which on nothing is computed."""

TOLD = 0.1  # odds from which on it is told (chosen: a look at the recording costs little)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Finding(Note):
    """One thing about a recording, its ``place``, that a sound one does not show."""

    labels: tuple[str, ...] = ()  # that it concerns
    exchanges: tuple[exchanged.Exchange, ...] = ()  # labels that, put right, solve it
    rivals: abc.Mapping[str, tuple[exchanged.Exchange, ...]] = dataclasses.field(default_factory=dict)
    """Other recordings in which the same, put right instead, would solve it."""

    def __str__(self) -> str:
        return f"{self.statement}: {self.remedy[0].lower()}{self.remedy[1:]}"


class NotAPerson(TrialUnusable):
    """What a recording shows cannot be a person as its labels say."""

    def __init__(self, findings: abc.Sequence[Finding]) -> None:
        first = next(one for one in findings if one.severity == "refusal")
        super().__init__(
            first.problem, file=first.place, field=", ".join(first.labels[:4]) or None, remedy=first.remedy
        )
        self.findings = tuple(findings)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """What is said of the person."""

    sex: Sex | None = None
    height_m: float | None = None
    mass_kg: float | None = None


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Recordings:
    """The recordings of one session, in m, before gaps are filled and positions smoothed.

    ``clusters``: segment to the labels on it. ``static``: the name of the one in which somebody stands.
    """

    trials: abc.Sequence[Trial]
    clusters: exchanged.Clusters = dataclasses.field(default_factory=dict)
    static: str | None = None
    stated: Stated = Stated()
    model: BodyModel | None = None


def sort_findings(found: abc.Iterable[Finding]) -> tuple[Finding, ...]:
    """Those that refuse first; labels that several questions found exchanged once for each recording."""
    kept: list[Finding] = []
    for one in found:
        same = (other for other in kept if other.place == one.place and {*one.labels} <= {*other.labels})
        if not one.exchanges or not any(other.exchanges for other in same):
            kept.append(one)
    return tuple(sorted(kept, key=lambda one: one.severity != "refusal"))


def refuse(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """The findings; raises NotAPerson if one of them is beyond doubt."""
    if any(one.severity == "refusal" for one in findings):
        raise NotAPerson(findings)
    return findings


def list_roles(trial: Trial) -> dict[str, str]:
    """Label to landmark, of those that are known and that no other label means, too."""
    roles = {label: role for label in trial.labels if (role := find_canonical(label)) is not None}
    every = list(roles.values())
    return {label: role for label, role in roles.items() if every.count(role) == 1}


def name_landmarks(trial: Trial) -> Trial:
    """The labels of :func:`list_roles`, renamed to their landmarks."""
    return trial.relabel(list_roles(trial))
