"""What became of each case."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scaling_service.files.sto import read_sto
from tests.blind.scoring.matching import (
    best,
    intervals_hold,
    opposite,
    parameters_right,
    size,
    smallest_nameable,
)
from tests.blind.scoring.records import Record

Json = dict[str, Any]


@dataclass(frozen=True)
class Outcome:
    """One case's truth beside its result.

    Parameters
    ----------
    truth : mapping
        The label.
    result : mapping, optional
        ``discovery.json``; None if the program failed.
    seconds : float, optional
        That it took.
    withheld : float, optional
        RMS error of the vertical force inferred for a foot whose plate was withheld, share of body weight, in
        the worst trial; infinite where none was inferred.
    code : str
        Fingerprint of the search.
    """

    truth: Json
    result: Json | None
    seconds: float | None
    withheld: float | None = None
    code: str = ""

    @property
    def effects(self) -> list[Json]:
        """What was named, in the result's order."""
        return list(self.result.get("effects", [])) if self.result else []

    @property
    def hidden(self) -> list[Json]:
        """What is true."""
        return list(self.truth["hidden"])

    @property
    def matches(self) -> list[str]:
        """For each hidden thing: exact, class or no."""
        return [best(thing, self.effects)[0] for thing in self.hidden]

    @property
    def superfluous(self) -> int:
        """Effects named that are not hidden."""
        return sum(all(best(thing, [effect])[0] == "no" for thing in self.hidden) for effect in self.effects)

    @property
    def ratio(self) -> float | None:
        """Size of the (first) hidden thing over the result's own smallest nameable size."""
        stated = smallest_nameable(self.hidden[0], self.result or {}) if self.hidden else None
        return size(self.hidden[0]) / stated if stated else None

    @property
    def exact(self) -> list[tuple[Json, Json]]:
        """Hidden things named exactly, and as what."""
        found = [(thing, *best(thing, self.effects)) for thing in self.hidden]
        return [(thing, dict(effect)) for thing, kind, effect in found if kind == "exact" and effect]

    @property
    def parameters(self) -> list[bool]:
        """Whether each parameter of the exactly named things is right."""
        return [right for pair in self.exact for right in parameters_right(*pair).values()]

    @property
    def intervals(self) -> list[bool]:
        """Whether the stated interval of each of those parameters holds the truth."""
        return [holds for pair in self.exact for holds in intervals_hold(*pair).values()]

    @property
    def floor(self) -> float | None:
        """The markers' floor over what the noise put in leaves after tracking, where the label tells it."""
        stated = (((self.result or {}).get("gap") or {}).get("fit") or {}).get("markers_mm")
        left = self.truth.get("noise_left_mm")
        return stated["floor"] / left if stated and left else None

    @property
    def opposite_sign(self) -> bool:
        """Whether a thing came out as its own negative."""
        return any(opposite(*pair) for pair in self.exact)

    @property
    def record(self) -> Record:
        """In one line."""
        truth = self.truth
        return Record(
            id=truth["id"],
            group=truth["group"],
            kinds=tuple(truth["kinds"]),
            size=truth.get("size", ""),
            movement=truth.get("movement", ""),
            forces=truth["forces"],
            hidden=tuple(map(_named, self.hidden)),
            everywhere=bool(self.hidden) and self.hidden[0].get("trials") is None,
            verdict=str((self.result or {}).get("verdict", "failed")),
            named=tuple(map(_named, self.effects)),
            matches=tuple(self.matches),
            ratio=self.ratio,
            closed=self.closed(),
            parameters=tuple(self.parameters),
            opposite=self.opposite_sign,
            superfluous=self.superfluous,
            stranger_seen=self.stranger_seen,
            seconds=self.seconds,
            withheld=self.withheld,
            code=self.code,
            intervals=tuple(self.intervals),
            floor=self.floor,
            stands=self.stands,
        )

    def closed(self) -> float | None:
        """Share of the held-out gap that was closed, down to what all that is ordinary would leave."""
        gap = ((self.result or {}).get("gap") or {}).get("held_out") or {}
        whole = gap.get("whitened")
        if not whole or any(whole.get(k) is None for k in ("before", "after", "ceiling")):
            return None
        closable = whole["before"] - whole["ceiling"]
        return (whole["before"] - whole["after"]) / closable if closable > 0 else None

    @property
    def stands(self) -> float | None:
        """How far the hidden things' places stand above what is ordinary there, where that is known."""
        here = [d for d in (self.result or {}).get("disagreements", []) if d["where"] in self._places]
        return max((d["rms"] / d["floor"] for d in here if d["floor"]), default=None)

    @property
    def _places(self) -> set[str]:
        return {w for thing in self.hidden for w in (*thing["where"], *thing.get("also_where", []))}

    @property
    def stranger_seen(self) -> bool:
        """Whether nothing was named, and what stands highest above its floor lies at the stranger's place."""
        left = (self.result or {}).get("unexplained", [])
        if self.effects or not left:
            return False
        highest = max(left, key=lambda item: item["rms"] / item["floor"] if item.get("floor") else 0.0)
        return bool(self._places & set(highest.get("where", [])))


def outcomes(bank: Path, results: Path) -> Iterator[Outcome]:
    """Every case that was run, in the order of the labels' names."""
    for label in sorted((bank / "labels").glob("*.json")):
        folder = results / label.stem
        if (folder / "discovery.json").is_file() or (folder / "failed.txt").is_file():
            truth = {**json.loads(label.read_text(encoding="utf-8")), "id": label.stem}
            withheld = _withheld(label.with_suffix(""), folder, truth)
            yield Outcome(truth, _result(folder), _seconds(folder), withheld, _code(folder))


def _named(thing: Json) -> str:
    return " ".join([thing["kind"], *thing["where"]])


def _code(folder: Path) -> str:
    file = folder / "code.txt"
    return file.read_text(encoding="utf-8").strip() if file.is_file() else ""


def _result(folder: Path) -> Json | None:
    file = folder / "discovery.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None


def _seconds(folder: Path) -> float | None:
    file = folder / "seconds.txt"
    return float(file.read_text(encoding="utf-8")) if file.is_file() else None


def _withheld(true: Path, folder: Path, truth: Json) -> float | None:
    """The worst trial's error; the true forces lie in a folder beside the label."""
    errors = []
    for file in sorted(true.glob("*.sto")):
        found = folder / f"{file.stem}_contact.sto"
        if not found.is_file():
            return float("inf")
        measured, inferred = read_sto(file).data, read_sto(found)
        vertical = np.interp(inferred.data[:, 0], measured[:, 0], measured[:, 1])
        wrong = inferred.data[:, inferred.columns.index("contact_fy")] - vertical
        errors.append(float(np.sqrt(np.mean(wrong**2))) / (9.81 * truth["body_mass_kg"]))
    return max(errors, default=None)
