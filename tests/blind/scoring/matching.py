"""Whether what was named is what was hidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

Json = Mapping[str, Any]
Match = Literal["exact", "class", "no"]

LARGEST_CLASS = 3
"""Members of a class that still counts as an answer: the effect and those it can be confused with."""


INTERVAL_SD = 1.96
"""Half of a 95 % interval of the normal law."""


def same(truth: Json, named: Json) -> bool:
    """Equal kind and equal set of places."""
    return truth["kind"] == named["kind"] and set(truth["where"]) == set(named["where"])


def match(truth: Json, effect: Json) -> Match:
    """Whether a named effect is the hidden one, or its declared class of at most three holds it."""
    if same(truth, effect):
        return "exact"
    twins = effect.get("confusable_with", [])
    if len(twins) + 1 <= LARGEST_CLASS and any(same(truth, twin) for twin in twins):
        return "class"
    return "no"


def best(truth: Json, effects: Sequence[Json]) -> tuple[Match, Json | None]:
    """The best match among the named effects."""
    found = [(match(truth, effect), effect) for effect in effects]
    for wanted in ("exact", "class"):
        for kind, effect in found:
            if kind == wanted:
                return kind, effect
    return "no", None


def amounts(parameters: Mapping[str, float]) -> dict[str, float]:
    """Parameters as departures from nothing: a factor is told from one."""
    return {name: value - 1.0 if name == "factor" else value for name, value in parameters.items()}


_MAIN = ("factor", "delay_s", "about_vertical_deg", "kg", "rms_N", "rms_deg", "rms_mm", "creep_mm", "limit")


def size(truth: Json) -> float:
    """One number for how large a hidden effect is, in its own unit: a vector's length, or the main parameter.

    For a swap the seconds that it lasts; for wobbling skin the period.
    """
    values = amounts(truth["parameters"])
    if truth["kind"] == "marker_swap":
        return values["end_s"] - values["start_s"]
    if truth["kind"] == "skin_wobble":
        return 1.0 / values["frequency_hz"]
    for name in _MAIN:
        if name in values:
            return abs(values[name])
    return float(np.linalg.norm(list(values.values())))


def smallest_nameable(truth: Json, result: Json) -> float | None:
    """What the result itself says is the smallest nameable size of the hidden kind at its place.

    It is looked for beside the effect, then among what was tried, then in a list of its own, as the number or
    the mapping of parameters ``smallest_nameable``; None where the result does not say.
    """
    listed = result.get("smallest_nameable", [])
    places = [
        *result.get("effects", []),
        *result.get("tried", []),
        *(listed if isinstance(listed, list) else []),
    ]
    for entry in places:
        if not same(truth, entry):
            continue
        stated = entry.get("smallest_nameable", entry.get("evidence", {}).get("smallest_nameable"))
        if stated is None:
            continue
        return _stated_size(truth, stated) if isinstance(stated, Mapping) else float(stated)
    return None


def _stated_size(truth: Json, stated: Mapping[str, Any]) -> float | None:
    """A stated size in the unit of ``size``; None where it is told in other parameters than the truth.

    A factor may be stated as such (1.01) or as the departure from one (0.01).
    """
    numbers = {k: v["value"] if isinstance(v, Mapping) else v for k, v in stated.items()}
    plain = {k: float(v) for k, v in numbers.items() if isinstance(v, int | float)}
    if abs(plain.get("factor", 1.0)) < 0.5:
        plain["factor"] += 1.0
    timed = {"marker_swap": {"start_s", "end_s"}, "skin_wobble": {"frequency_hz"}}
    if not plain or not timed.get(truth["kind"], set()) <= set(plain):
        return None
    return size({**truth, "parameters": plain})


def parameters_right(truth: Json, effect: Json) -> dict[str, bool]:
    """Whether each parameter that is told is within 10 % of the effect's size or two sd.

    A component of a vector is held against the vector's length, a time against the interval's length.
    """
    wanted, found = amounts(truth["parameters"]), effect.get("parameters", {})
    shared = [
        name
        for name in wanted
        if isinstance(found.get(name), Mapping) and found[name].get("value") is not None
    ]
    values = amounts({name: float(found[name]["value"]) for name in shared})
    allowed = {n: max(0.1 * _scale(n, wanted), 2.0 * float(found[n].get("sd") or 0.0)) for n in shared}
    return {n: abs(values[n] - wanted[n]) <= allowed[n] for n in shared}


def intervals_hold(truth: Json, effect: Json) -> dict[str, bool]:
    """Whether the stated 95 % interval of each parameter that has one holds the truth."""
    wanted, found = truth["parameters"], effect.get("parameters", {})
    stated = {n: found[n] for n in wanted if isinstance(found.get(n), Mapping) and found[n].get("sd")}
    return {n: abs(float(v["value"]) - wanted[n]) <= INTERVAL_SD * float(v["sd"]) for n, v in stated.items()}


def opposite(truth: Json, effect: Json) -> bool:
    """Whether the parameters come out as the negative of the truth: a disagreement on signs, not on size."""
    wanted, found = amounts(truth["parameters"]), effect.get("parameters", {})
    named = [n for n in wanted if isinstance(found.get(n), Mapping) and found[n].get("value") is not None]
    if not named:
        return False
    values = amounts({n: float(found[n]["value"]) for n in named})
    a, b = np.array([values[n] for n in named]), np.array([wanted[n] for n in named])
    return bool(a @ b < 0 and np.linalg.norm(a + b) < 0.3 * np.linalg.norm(b))


def _scale(name: str, wanted: Mapping[str, float]) -> float:
    if name in {"start_s", "end_s"}:
        return wanted["end_s"] - wanted["start_s"]
    unit = name.split("_", 1)[-1]
    if name[0] in "xyz" or name[:2] in {"fx", "fy", "fz"}:
        return float(np.linalg.norm([v for n, v in wanted.items() if n.split("_", 1)[-1] == unit]))
    return abs(wanted[name])
