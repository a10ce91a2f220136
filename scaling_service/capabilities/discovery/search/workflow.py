"""Find what is missing, and show what it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from scaling_service.capabilities.discovery.evidence.demands import forget
from scaling_service.capabilities.discovery.evidence.fitting import Account, Recording, account, scene_of
from scaling_service.capabilities.discovery.laws.additions import Sized
from scaling_service.capabilities.discovery.search.candidates import Masked
from scaling_service.capabilities.discovery.search.comparing import forget_sums
from scaling_service.capabilities.discovery.search.findings import Findings
from scaling_service.capabilities.discovery.search.hindsight import at_rest, without_the_ill_fitting
from scaling_service.capabilities.discovery.search.refining import ROUGHLY, refined
from scaling_service.capabilities.discovery.search.searching import Progress, Search
from scaling_service.capabilities.discovery.search.strictness import DiscoverySettings
from scaling_service.capabilities.discovery.search.sufficient import without_the_insufficient
from scaling_service.capabilities.discovery.search.telling import told
from scaling_service.model.body import BodyModel


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
    before = account(model, recordings, free)
    now = refined(before, recordings, [], settings.stretch_s, ROUGHLY) if free else before
    search = Search(recordings, settings, report, now)
    options = search.finish()
    report("settling all numbers", 0.85)
    scene, stretch_s = scene_of(before), settings.stretch_s
    named, now = without_the_ill_fitting(search.named, search.now, before, recordings, scene, stretch_s)
    named, now = at_rest(named, now, recordings, stretch_s)
    named, now, said = without_the_insufficient(named, now, before, recordings, scene, stretch_s)
    now, seen = _unmasked(now, recordings)
    report("measuring the gap", 0.9)
    findings = told(named, options, search.odd_law, before, now, seen, recordings, settings, (*notes, *said))
    forget()
    forget_sums()
    report("done", 1.0)
    return Discovery(findings, before, now)


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
