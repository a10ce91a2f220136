"""Find what is missing, effect after effect, until nothing that is left passes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scaling_service.discovery.additions import Sized
from scaling_service.discovery.candidates import Masked
from scaling_service.discovery.ceilings import absorbed, black_box
from scaling_service.discovery.findings import Findings, Gap, Named, Verdict
from scaling_service.discovery.fitting import Account, Recording, account, refined
from scaling_service.discovery.gaps import gap
from scaling_service.discovery.hindsight import looked_back
from scaling_service.discovery.locating import disagreements
from scaling_service.discovery.nameable import smallest_nameable
from scaling_service.discovery.option import Option
from scaling_service.discovery.options import Options, confusable, look
from scaling_service.discovery.remainder import unexplained
from scaling_service.discovery.scene import Scene
from scaling_service.discovery.separating import would_separate
from scaling_service.discovery.strangers import strangers
from scaling_service.discovery.tallies import Floors, floors_of, marker_tally
from scaling_service.discovery.tuning import tuned
from scaling_service.discovery.watched import Role
from scaling_service.discovery.weighed import Weighed
from scaling_service.models.body import GROUND, BodyModel

Progress = Callable[[str, float], None]

CLEARLY = 1.3
"""How much more a free course of one marker must explain than a law (chosen: a law that is right explains all
but noise, and the free course takes that too)."""

_STILL_RAD = np.radians(2.0)
"""A coordinate that spreads less drives nothing that could be told from a constant (chosen)."""


@dataclass(frozen=True, slots=True)
class DiscoverySettings:
    """How strict the search is.

    Parameters
    ----------
    level : float
        Family-wise: of naming anything where nothing is.
    stretch_s : float
        Length of the stretches of time that count as independent, s.
    most : int
        Effects to name at most, of markers and of forces each.
    shortlist : int
        Candidates that are compared with each other.
    strangers : int
        Markers at most that are left out because they go their own way.
    """

    level: float = 0.05
    stretch_s: float = 0.5
    most: int = 6
    shortlist: int = 30
    strangers: int = 3


@dataclass(frozen=True, slots=True, eq=False)
class Discovery:
    """The whole story, and the two accounts between which it goes.

    Parameters
    ----------
    findings : Findings
    before, after : Account
    """

    findings: Findings
    before: Account
    after: Account


def discover(
    model: BodyModel,
    recordings: Sequence[Recording],
    free: Sequence[Sized] = (),
    settings: DiscoverySettings = DiscoverySettings(),
    progress: Progress | None = None,
    notes: Sequence[str] = (),
) -> Discovery:
    """Search the catalogue for what the model does not have.

    Parameters
    ----------
    model : BodyModel
        Without parameters; with mass where forces are given.
    recordings : sequence of Recording
        Not smoothed, not filled.
    free : sequence of Sized
        What the calibration could have explained, at zero.
    notes : sequence of str
        What is known already of what could not be tried.

    Raises
    ------
    TrialUnusable
        A trial shows no marker of the model.
    """
    report = progress or _silent
    report("following the recordings", 0.0)
    before = now = account(model, recordings, free)
    named: list[Named] = []
    while True:
        found, options = _next(now, named, settings, report)
        masked = [e for e in now.effects if isinstance(e.candidate.change, Masked)]
        odd = _stranger(now, options, settings) if len(masked) < settings.strangers else None
        if odd is not None:
            now = account(model, recordings, now.free, (*now.effects, odd), now)
            continue
        if not found:
            break
        now = refined(now, recordings, [n.effect for n in found], settings.stretch_s)
        named += found
    report("looking back", 0.85)
    named, now = looked_back(named, now, before, recordings, scene_of(before), settings.stretch_s)
    kept = [e for e in now.effects if not isinstance(e.candidate.change, Masked)]
    if len(kept) < len(now.effects):
        now = account(model, recordings, now.free, kept, now)
    return Discovery(_told(named, options, before, now, recordings, settings, report, notes), before, now)


def _silent(what: str, share: float) -> None:
    """No progress is shown."""


def _next(
    now: Account, named: Sequence[Named], settings: DiscoverySettings, report: Progress
) -> tuple[list[Named], Options]:
    """The best effect of the motion and the best of the forces that pass, and all options."""
    report(f"looking for effect {len(named) + 1}", min(0.8, 0.8 * len(named) / settings.most))
    options = look(now, scene_of(now), settings.stretch_s, settings.shortlist)
    found = []
    for of_forces in (False, True):
        room = settings.most - sum(n.effect.candidate.of_forces == of_forces for n in named)
        passing = [
            o for o in options.best if o.candidate.of_forces == of_forces and _passes(o, options, settings)
        ]
        if passing and room > 0:
            found.append(_named(passing[0], options, now, settings))
    return found, options


def _stranger(now: Account, options: Options, settings: DiscoverySettings) -> Sized | None:
    """A marker that goes its own way, if that explains clearly more than any law, be it sure or not."""
    laws = [o.fitted.expected for o in options.best if not o.candidate.of_forces]
    known = {e.candidate.where for e in now.effects if isinstance(e.candidate.change, Masked)}
    odd = [
        (fitted.expected, candidate)
        for candidate, fitted in strangers(scene_of(now), now.watched, settings.stretch_s)
        if fitted.p * options.count <= settings.level and candidate.where not in known
    ]
    best = max(odd, key=lambda each: each[0], default=None)
    if best is None or best[0] <= CLEARLY * max(laws, default=0.0):
        return None
    return Sized(best[1], np.zeros(0))


def _passes(option: Option, options: Options, settings: DiscoverySettings) -> bool:
    fitted, tried = option.fitted, option.unseen
    likely = fitted.p * options.count <= settings.level and fitted.expected > 0.0
    return likely and tried.p <= settings.level and tried.gain > 0.0


def _named(option: Option, options: Options, now: Account, settings: DiscoverySettings) -> Named:
    option = tuned(option, now, scene_of(now), settings.stretch_s)
    effect = Sized(option.candidate, option.fitted.size)
    twins = confusable(option, options.best)
    return Named(
        effect,
        option.fitted.covariance,
        {},
        smallest_nameable(effect, option.fitted, settings.level / options.count),
        option.fitted,
        min(1.0, option.fitted.p * options.count),
        option.unseen,
        twins,
        would_separate(effect, twins, now) if twins else "",
    )


def _told(
    named: Sequence[Named],
    options: Options,
    before: Account,
    after: Account,
    recordings: Sequence[Recording],
    settings: DiscoverySettings,
    report: Progress,
    notes: Sequence[str],
) -> Findings:
    report("measuring the gap", 0.9)
    scene = scene_of(before)
    floors = floors_of(after, scene.moving, settings.stretch_s)
    places = disagreements(before, settings.stretch_s, floors)
    left = unexplained(after, settings.stretch_s, floors)
    verdict: Verdict = "found" if named else "unexplained" if left else "nothing"
    folds = not any(item.role == "held_out" for item in before.watched)
    gaps = _gaps(named, before, after, recordings, scene, settings, folds, floors)
    spent = any(
        sum(n.effect.candidate.of_forces == kind for n in named) >= settings.most for kind in (False, True)
    )
    reason = (
        f"{settings.most} effects of one kind were named, the most that are looked for"
        if spent
        else "nothing in the catalogue explains what is left better than chance"
    )
    report("done", 1.0)
    return Findings(
        verdict,
        places,
        tuple(named),
        gaps["fit"],
        gaps["fit" if folds else "held_out"],
        folds,
        tuple(o for o in options.best if o.candidate.name not in {n.effect.candidate.name for n in named}),
        left,
        reason,
        (*notes, *_limits(before, folds)),
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


def scene_of(now: Account) -> Scene:
    """What the recordings show of the body."""
    model = now.model
    shown = {m for item in now.watched for m in item.markers}
    names = tuple(m for m in model.marker_names if m in shown)
    q = np.concatenate([item.q[:, : len(model.coordinates)] for item in now.watched])
    moved = [s for s in model.segments if s.parent == GROUND]
    roots = {t.coordinate for s in moved for j in s.joints for t in j.law.terms}
    moving = tuple(
        c.name
        for c, spread in zip(model.coordinates, q.std(axis=0), strict=True)
        if c.kind == "rotation" and c.name not in roots and spread > _STILL_RAD
    )
    plates = dict.fromkeys(name for item in now.weighed for name in _loaded(item))
    trials, weighed = (tuple(item.name for item in items) for items in (now.watched, now.weighed))
    return Scene(model, names, moving, trials, tuple(plates), weighed)


def _loaded(item: Weighed) -> list[str]:
    """The plates that bear something in a trial."""
    ground = item.footing.ground
    return [name for k, name in enumerate(ground.plates) if ground.in_contact()[:, k].any()]
