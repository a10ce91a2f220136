"""What a search found, told with its gaps and limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.discovery.disturbances.remainder import unexplained
from scaling_service.capabilities.discovery.evidence.ceilings import absorbed, black_box
from scaling_service.capabilities.discovery.evidence.fitting import Account, Recording, scene_of
from scaling_service.capabilities.discovery.evidence.gaps import gap
from scaling_service.capabilities.discovery.evidence.locating import disagreements
from scaling_service.capabilities.discovery.evidence.watched import Role
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.findings import Findings, Foreign, Gap, Named, Verdict
from scaling_service.capabilities.discovery.search.options import Options
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings
from scaling_service.capabilities.discovery.search.tallies import Floors, floors_of, marker_tally

_FOREIGN = (
    "the recordings follow a law that the catalogue does not have, clearly better than any that it has: "
    "repair what it describes and search again"
)
_SPENT = "{} effects of one kind were named, the most that are looked for"
_NOTHING_MORE = "nothing in the catalogue explains what is left better than chance"


def told(
    named: Sequence[Named],
    options: Options,
    odd_law: Foreign | None,
    before: Account,
    after: Account,
    seen: Account,
    recordings: Sequence[Recording],
    settings: DiscoverySettings,
    notes: Sequence[str],
) -> Findings:
    """The story of a search: where, what, how far the gap closed, and what is left.

    Parameters
    ----------
    seen : Account
        As ``after``, with the motion as it is without the markers that go their own way.
    """
    scene = scene_of(before)
    floors = floors_of(after, scene.moving, settings.stretch_s)
    places = disagreements(before, settings.stretch_s, floors)
    usual = floors if seen is after else floors_of(seen, scene.moving, settings.stretch_s)
    left = unexplained(seen, settings.stretch_s, usual, odd_law)
    verdict: Verdict = "found" if named else "unexplained" if left else "nothing"
    folds = not any(item.role == "held_out" for item in before.watched)
    gaps = _gaps(named, before, after, recordings, scene, settings, folds, floors)
    spent = any(
        sum(n.effect.candidate.of_forces == kind for n in named) >= settings.most for kind in (False, True)
    )
    ended = _SPENT.format(settings.most) if spent else _NOTHING_MORE
    return Findings(
        verdict,
        places,
        tuple(named),
        gaps["fit"],
        gaps["fit" if folds else "held_out"],
        folds,
        tuple(o for o in options.best if o.candidate.key not in {n.effect.candidate.key for n in named}),
        left,
        _FOREIGN if odd_law else ended,
        (*notes, *_limits(before, folds), *([_FOREIGN] if odd_law else [])),
    )


def _gaps(
    named: Sequence[Named],
    before: Account,
    after: Account,
    recordings: Sequence[Recording],
    scene: Scene,
    settings: DiscoverySettings,
    folds: bool,
    floors: Floors,
) -> dict[Role, Gap]:
    count = sum(max(len(n.effect.candidate.columns), 1) for n in named if not n.effect.candidate.of_forces)
    shares = black_box(before, scene, count, settings.stretch_s) if count else {"fit": 1.0, "held_out": 1.0}
    swallowed = absorbed(before, recordings, scene, settings.stretch_s) if named else before
    found: dict[Role, Gap] = {}
    roles: tuple[Role, ...] = ("fit",) if folds else ("fit", "held_out")
    for role in roles:
        reached = _whitened(swallowed, role, settings.stretch_s, floors)
        ceiling = {"markers": shares[role]}
        found[role] = gap(before, after, role, settings.stretch_s, floors, ceiling=ceiling, absorbed=reached)
    return found


def _whitened(now: Account, role: Role, stretch_s: float, floors: Floors) -> float:
    tally = marker_tally(now, role, stretch_s, floors)
    if tally is None:
        return float("nan")
    ratio = tally.square.sum(axis=0) / tally.floor.sum(axis=0).clip(1e-300)
    frames = tally.frames.sum(axis=0)
    return float((ratio @ frames / frames.sum()) ** 0.5)


def _limits(before: Account, folds: bool) -> tuple[str, ...]:
    said = []
    if folds:
        said.append(
            "no trial was held out: effects were tried on blocks of time between those that fitted them"
        )
    longest = max(float(np.ptp(item.trial.times)) for item in before.watched)
    if len(before.watched) == 1 and longest < 5.0:
        undecided = "what changes from trial to trial, and small effects, cannot be decided"
        said.append(f"one trial of {longest:.1f} s: {undecided}")
    return tuple(said)
