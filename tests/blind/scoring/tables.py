"""The tables: must reach, confusion matrix, detection curves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import beta

from tests.blind.cases import NAMEABLE, SIZES
from tests.blind.effects import EFFECTS
from tests.blind.scoring.records import Record

Rows = list[list[str]]

_STANDING = 2.0
"""Times what is ordinary at its places, from which a stranger stands out of people (as effects are sized)."""

_FLOOR_MISS = 0.15
"""Of what the noise put in leaves (chosen: what a floor by residuals of some seconds can be held to)."""


def upper_bound(hits: int, n: int, confidence: float = 0.95) -> float:
    """One-sided upper bound of a share (Clopper and Pearson 1934)."""
    return 1.0 if hits >= n else float(beta.ppf(confidence, hits + 1, n - hits))


def must_reach(all_: Sequence[Record]) -> Rows:
    """What, at least, reached, of how many."""
    effects = _group(all_, "effect")
    nulls = _group(all_, "null")
    named = [o for o in nulls if o.named]
    rows = [["what", "at least", "reached", "cases"]]
    sized = [o.right for o in effects if o.size == NAMEABLE]
    rows.append(_share("named right or by class, 2 to 4 x the smallest nameable", "85 %", sized))
    bound = f", upper bound {100 * upper_bound(len(named), len(nulls)):.1f} %" if nulls else ""
    row = _share("something named on null recordings", "<= 2 %", [bool(o.named) for o in nulls])
    rows.append([row[0], row[1], row[2] + bound, row[3]])
    rows.append(_closed(effects))
    judged = [o.parameters for o in effects if o.parameters]
    rows.append(
        _share("parameters within 10 % or 2 sd", "95 %", [right for each in judged for right in each])
    )
    held = [holds for o in effects for holds in o.intervals]
    rows.append(_share("95 % intervals that hold the truth", "90 to 98 %", held))
    floors = [abs(o.floor - 1.0) <= _FLOOR_MISS for o in all_ if o.floor is not None]
    rows.append(_share("markers' floor within 15 % of what the noise leaves", "100 %", floors))
    rows.append(_share("effects all of whose parameters are", "-", [all(each) for each in judged]))
    rows.append(_share("both of two effects right", "85 %", [o.right for o in _group(all_, "pair")]))
    rows.append(
        _share("both of two opposed effects right", "85 %", [o.right for o in _group(all_, "opposed")])
    )
    strangers = _group(all_, "stranger")
    seen = [o.stranger_seen for o in strangers if o.stands is None or o.stands >= _STANDING]
    rows.append(_share("strangers that stand out, called unexplained at the right place", "85 %", seen))
    rows.append(_share("strangers named as something", "<= 5 %", [bool(o.named) for o in strangers]))
    rows += [
        ["the withheld foot's vertical force, RMSE", "<= 5 % BW", f"{100 * o.withheld:.1f} % BW", "1"]
        for o in all_
        if o.withheld is not None
    ]
    for forces, text, limit in ((False, "time, markers only", "60 s"), (True, "time, with forces", "300 s")):
        seconds = [o.seconds for o in all_ if o.forces == forces and o.seconds is not None]
        reached = f"median {np.median(seconds):.0f} s, longest {max(seconds):.0f} s" if seconds else "-"
        rows.append([text, limit, reached, str(len(seconds))])
    return rows


def remarks(all_: Sequence[Record]) -> list[str]:
    """What the table does not show."""
    effects = _group(all_, "effect")
    lines = []
    failed = Counter(o.group for o in all_ if o.verdict == "failed")
    if failed:
        lines.append(
            "Failed, counted as not named: " + ", ".join(f"{n} {g}" for g, n in failed.items()) + "."
        )
    extra = sum(o.superfluous > 0 for o in effects)
    lines.append(f"Something that is not hidden was named beside in {extra} of {len(effects)} effect cases.")
    opposed = Counter(o.kinds[0] for o in effects if o.opposite)
    if opposed:
        kinds = ", ".join(f"{kind} {n}" for kind, n in opposed.items())
        lines.append(f"Parameters with the opposite sign, right in size: {kinds}.")
    lines += _intervals(effects)
    verdicts = Counter(o.kinds[0] + " " + o.first_name for o in _group(all_, "null"))
    if verdicts:
        lines.append(
            "Null recordings: " + ", ".join(f"{n} x {name}" for name, n in sorted(verdicts.items())) + "."
        )
    searches = Counter(o.code or "not told" for o in all_)
    if len(searches) > 1:
        each = ", ".join(f"{code} {n}" for code, n in sorted(searches.items()))
        lines.append(f"Run by {len(searches)} versions of the search, cases each: {each}.")
    classes = sum("class" in o.matches for o in effects)
    lines.append(
        f"Right by the declared class only: {classes} of {sum(o.right for o in effects)} named right."
    )
    return lines


def _intervals(effects: Sequence[Record]) -> list[str]:
    """An interval in one fitted trial cannot be seen on the held-out ones, so these are told apart."""
    lines = []
    for kind in ("marker_swap", "external_contact"):
        here = [o for o in effects if o.kinds == (kind,)]
        everywhere, once = (
            _percent([o.right for o in here if o.everywhere == wanted]) for wanted in (True, False)
        )
        if here:
            lines.append(
                f"{kind} named right: {everywhere} where in all trials, {once} where in the first only."
            )
    return lines


def confusion(all_: Sequence[Record]) -> Rows:
    """Hidden kind (rows) against the first kind named (columns), all sizes."""
    chosen = [o for o in all_ if o.group in {"effect", "null", "stranger"}]
    counts = Counter((_row_name(o), o.first_name) for o in chosen)
    names = sorted({r for r, _ in counts}, key=_order)
    columns = sorted({c for _, c in counts}, key=_order)
    numbers = {c: str(k + 1) for k, c in enumerate(columns)}
    rows = [["hidden \\ named", *numbers.values()]]
    rows += [
        [f"{r} ({numbers[r]})" if r in numbers else r, *(str(counts[r, c] or ".") for c in columns)]
        for r in names
    ]
    others = [c for c in columns if c not in names]
    rows += [[f"named: {c} ({numbers[c]})", *("" for _ in columns)] for c in others]
    return rows


def real_cases(all_: Sequence[Record]) -> Rows:
    """Each real recording: what was hidden and what was named."""
    rows = [["real recording", "hidden", "verdict", "named", "right"]]
    for o in _group(all_, "real"):
        hidden, named = "; ".join(o.hidden) or "nothing", "; ".join(o.named) or "-"
        right = "" if not o.hidden else "yes" if o.right else "no"
        rows.append([o.kinds[0], hidden, o.verdict, named, right])
    return rows


def detection(all_: Sequence[Record]) -> Rows:
    """Power by kind: share named right by the bank's sizes, and by ratios to the smallest nameable size."""
    edges = (0.0, 1.0, 1.5, 3.0, np.inf)
    rows = [["kind", "unit", *SIZES, NAMEABLE, "< 1 x", "1-1.5 x", "1.5-3 x", ">= 3 x"]]
    effects = _group(all_, "effect")
    for kind, effect in EFFECTS.items():
        here = [o for o in effects if o.kinds == (kind,)]
        if not here:
            continue
        cells = []
        for name, amount in zip(SIZES, effect.sizes, strict=True):
            rights = [o.right for o in here if o.size == name]
            cells.append(f"{amount:.3g}: {_percent(rights)}")
        cells.append(_percent([o.right for o in here if o.size == NAMEABLE]))
        for low, high in pairwise(edges):
            cells.append(_percent([o.right for o in here if o.ratio is not None and low <= o.ratio < high]))
        rows.append([kind, effect.unit, *cells])
    return rows


def text(rows: Rows) -> str:
    """Columns side by side."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join(lines)


def markdown(rows: Rows) -> str:
    """The same for a page."""
    head, *body = ["| " + " | ".join(cell.replace("|", "/") for cell in row) + " |" for row in rows]
    return "\n".join([head, "|" + "---|" * len(rows[0]), *body])


def _group(all_: Sequence[Record], group: str) -> list[Record]:
    return [o for o in all_ if o.group == group]


def _closed(effects: Sequence[Record]) -> list[str]:
    """How much of the gap from before to the floor was closed where the effect was named right."""
    shares = [share for o in effects if o.right and (share := o.closed) is not None]
    reached = "-"
    if shares:
        reached = (
            f"mean {100 * np.mean(np.clip(shares, -1, 1)):.0f} %, median {100 * np.median(shares):.0f} %"
        )
    return ["gap to the floor closed on held-out trials, named right", "90 %", reached, str(len(shares))]


def _share(what: str, at_least: str, hits: Sequence[bool]) -> list[str]:
    return [what, at_least, _percent(hits), str(len(hits))]


def _percent(hits: Sequence[bool]) -> str:
    return f"{100 * float(np.mean(hits)):.0f} %" if hits else "-"


def _row_name(o: Record) -> str:
    return o.kinds[0] if o.group != "null" else f"null {o.kinds[0]}"


def _order(name: str) -> tuple[int, str]:
    """Kinds first, then strangers and nulls, then verdicts."""
    return (0 if name in EFFECTS else 2 if name in {"nothing", "unexplained", "failed"} else 1, name)


Table = Callable[[Sequence[Record]], Rows]

TABLES: dict[str, Table] = {
    "Must reach": must_reach,
    "Confusion matrix": confusion,
    "Detection": detection,
    "Real recordings": real_cases,
}
