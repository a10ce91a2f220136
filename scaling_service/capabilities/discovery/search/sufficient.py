"""Whether what was named in the forces is their whole story.

Where the model follows the markers down to their noise, its motion is known, and a law that is right leaves
little of the forces' disagreement. One that leaves much of it stands for something that the catalogue does
not have: a clock that drifts looks somewhat like a plate's bias. Where the markers say that more is missing
anyhow, what is left is not held against anything.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from scaling_service.capabilities.discovery.evidence.fitting import Account, Recording
from scaling_service.capabilities.discovery.evidence.watched import Role
from scaling_service.capabilities.discovery.laws.scene import Scene
from scaling_service.capabilities.discovery.search.findings import Named
from scaling_service.capabilities.discovery.search.refining import refined
from scaling_service.capabilities.discovery.search.tallies import Tally, floors_of, marker_tally, wrench_tally

FOLLOWED = 0.5
"""Mean square above the floor, in floors, up to which markers count as followed (chosen: markers at 1.2 times
their noise)."""

LEFT = 0.25
"""Share of the forces' mean square above their floor that may be left (chosen)."""

SLIGHT = 0.5
"""Mean square above the floor, in floors, that the estimate of the floor itself may miss (chosen)."""

Tallied = Callable[[Account, Role], Tally | None]


REFUSED = (
    "the motion is known down to its noise, yet what the catalogue offers for the forces ({names}) leaves "
    "much of their disagreement: it is not named"
)


def without_the_insufficient(
    named: Sequence[Named],
    now: Account,
    before: Account,
    recordings: Sequence[Recording],
    scene: Scene,
    stretch_s: float,
) -> tuple[list[Named], Account, tuple[str, ...]]:
    """Effects of the forces that are not their whole story taken back, and what is told of it."""
    loads = [n for n in named if n.effect.candidate.of_forces]
    if not loads or sufficient(before, now, scene, stretch_s):
        return list(named), now, ()
    kept = tuple(e for e in now.effects if not e.candidate.of_forces)
    now = refined(replace(now, effects=kept), recordings, [], stretch_s, of_forces=True)
    names = ", ".join(n.effect.candidate.name for n in loads)
    return [n for n in named if n not in loads], now, (REFUSED.format(names=names),)


def sufficient(before: Account, after: Account, scene: Scene, stretch_s: float) -> bool:
    """Whether the effects that lie between two accounts explain the forces, as far as that can be told."""
    floors = floors_of(after, scene.moving, stretch_s)
    markers: Tallied = partial(marker_tally, stretch_s=stretch_s, floors=floors)
    forces: Tallied = partial(wrench_tally, stretch_s=stretch_s, floors=floors)
    roles: tuple[Role, ...] = ("fit", "held_out")
    if any(_excess(markers, after, role) > FOLLOWED for role in roles):
        return True
    left = [(_excess(forces, before, role), _excess(forces, after, role)) for role in roles]
    return all(now <= max(SLIGHT, LEFT * was) for was, now in left)


def _excess(tallied: Tallied, account: Account, role: Role) -> float:
    """Mean square of all places, each in its own floors, beyond one; none where nothing is measured."""
    tally = tallied(account, role)
    if tally is None:
        return 0.0
    frames, floor = tally.frames.sum(axis=0), tally.floor.sum(axis=0)
    shown = floor > 0.0
    ratio = tally.square.sum(axis=0)[shown] / floor[shown]
    return float((ratio * frames[shown]).sum() / frames[shown].sum() - 1.0)
