"""Find what is missing, effect after effect, until nothing that is left passes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from scaling_service.discovery.additions import Sized
from scaling_service.discovery.candidates import Candidate, Masked
from scaling_service.discovery.demands import forget
from scaling_service.discovery.findings import Findings, Named
from scaling_service.discovery.fitting import Account, Recording, account, scene_of, squares
from scaling_service.discovery.foreign import foreign
from scaling_service.discovery.hindsight import keeps_to_its_range, looked_back, sound
from scaling_service.discovery.nameable import smallest_nameable
from scaling_service.discovery.option import Option
from scaling_service.discovery.options import Options, confusable, look
from scaling_service.discovery.pairs import two_of_one_plate
from scaling_service.discovery.refining import ROUGHLY, refined
from scaling_service.discovery.rivals import Naming, revisited
from scaling_service.discovery.separating import would_separate
from scaling_service.discovery.strangers import stranger
from scaling_service.discovery.strictness import DiscoverySettings
from scaling_service.discovery.sufficient import without_the_insufficient
from scaling_service.discovery.telling import spent, told
from scaling_service.discovery.tuning import tuned
from scaling_service.discovery.widest import widest
from scaling_service.models.body import BodyModel

Progress = Callable[[str, float], None]

KEPT = 0.3
"""Share of what an effect promised to explain that it must explain when everything is estimated anew with it
(chosen: the promise is that of a small change; a law that is only right for small ones keeps little)."""


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
    refused: set[str] = set()
    options: Options | None = None
    while True:
        found, options = _next(now, named, refused, settings, report, options)
        odd_law = foreign(now, options, settings)
        if odd_law is not None:
            break
        masked = [e for e in now.effects if isinstance(e.candidate.change, Masked)]
        odd = stranger(now, options, settings) if len(masked) < settings.strangers else None
        if odd is not None:
            now = account(model, recordings, now.free, (*now.effects, odd), now)
            continue
        if not found:
            break
        tried = refined(now, recordings, [n.effect for n in found], settings.stretch_s, ROUGHLY)
        poor = [n for n in found if not (_keeps_its_promise(n, now, tried) and keeps_to_its_range(n, tried))]
        if not poor:
            now, named = tried, named + found
            named, now = revisited(named, now, _naming(recordings, options, settings))
            if spent(named, settings):
                kept, now = sound(named, now, recordings, settings.stretch_s)
                refused |= {n.effect.candidate.key for n in named if n not in kept}
                named = kept
        refused |= {n.effect.candidate.key for n in poor}
    report("looking back", 0.85)
    named, now = two_of_one_plate(named, now, _naming(recordings, options, settings))
    named, now = looked_back(named, now, before, recordings, scene_of(before), settings.stretch_s)
    named, now, said = without_the_insufficient(
        named, now, before, recordings, scene_of(before), settings.stretch_s
    )
    now, seen = _unmasked(now, recordings)
    report("measuring the gap", 0.9)
    findings = told(named, options, odd_law, before, now, seen, recordings, settings, (*notes, *said))
    forget()
    report("done", 1.0)
    return Discovery(findings, before, now)


def _naming(recordings: Sequence[Recording], options: Options, settings: DiscoverySettings) -> Naming:
    return Naming(recordings, settings, partial(_tuned, options=options, settings=settings))


def _unmasked(now: Account, recordings: Sequence[Recording]) -> tuple[Account, Account]:
    """The account with every marker again, and one of all markers whose motion the odd ones do not pull."""
    kept = [e for e in now.effects if not isinstance(e.candidate.change, Masked)]
    if len(kept) == len(now.effects):
        return now, now
    whole = account(now.model, recordings, now.free, kept, now)
    pairs = zip(whole.watched, now.watched, strict=True)
    return whole, replace(whole, watched=tuple(replace(item, q=other.q) for item, other in pairs))


def _silent(what: str, share: float) -> None:
    """No progress is shown."""


def _keeps_its_promise(n: Named, before: Account, after: Account) -> bool:
    """Whether the disagreement fell about as much as was expected once everything was estimated anew."""
    candidate = n.effect.candidate
    was, left = (squares(a, of_forces=candidate.of_forces, of=[candidate]) for a in (before, after))
    return was - left > KEPT * n.fitted.expected


def _next(
    now: Account,
    named: Sequence[Named],
    refused: set[str],
    settings: DiscoverySettings,
    report: Progress,
    before: Options | None,
) -> tuple[list[Named], Options]:
    """The best effect of the motion and the best of the forces that pass, and all options."""
    report(f"looking for effect {len(named) + 1}", min(0.8, 0.8 * len(named) / settings.most))
    options = look(now, scene_of(now), settings.stretch_s, settings.shortlist, before)
    found = []
    for of_forces in (False, True):
        room = settings.most - sum(n.effect.candidate.of_forces == of_forces for n in named)
        passing = [
            o for o in options.best if o.candidate.of_forces == of_forces and _passes(o, options, settings)
        ]
        if room > 0:
            trials = [item.name for item in now.watched]
            fitting = [item.name for item in now.watched if item.role == "fit"]
            first = _first(widest(passing, trials, fitting), options, now, refused, settings)
            found += [] if first is None else [first]
    return found, options


def _first(
    passing: Sequence[Option],
    options: Options,
    now: Account,
    refused: set[str],
    settings: DiscoverySettings,
) -> Named | None:
    """The best that is not refused; what swings is refused if no plausible swing fits."""
    for option in passing:
        if option.candidate.key not in refused:
            named = _tuned(option, now, options, settings)
            if named is not None:
                return named
            refused.add(option.candidate.key)
    return None


def _tuned(option: Option, now: Account, options: Options, settings: DiscoverySettings) -> Named | None:
    """An option as a named effect, at the frequency that explains most; None where no swing is plausible."""
    best = tuned(option, now, scene_of(now), settings.stretch_s)
    return None if best is None else _named(best, options, now, settings)


def _passes(option: Option, options: Options, settings: DiscoverySettings) -> bool:
    fitted, tried = option.fitted, option.unseen
    likely = fitted.p * options.count <= settings.level and fitted.expected > 0.0
    return likely and tried.p <= settings.level and tried.gain > 0.0


def _named(option: Option, options: Options, now: Account, settings: DiscoverySettings) -> Named:
    effect = Sized(option.candidate, option.fitted.size)
    twins = confusable(option, options.best)
    return Named(
        effect,
        option.fitted.spread,
        {},
        {},
        smallest_nameable(effect, option.fitted, settings.level / options.count),
        option.fitted,
        min(1.0, option.fitted.p * options.count),
        option.unseen,
        twins,
        would_separate(effect, twins, now) if twins else "",
        tuple(o.candidate for o in options.best if _comparable(o.candidate, option.candidate)),
    )


def _comparable(other: Candidate, candidate: Candidate) -> bool:
    """Whether both are sums of columns of the same sort."""
    return bool(other.columns and candidate.columns) and other.of_forces == candidate.of_forces
