"""Find what is missing, round after round, until nothing that is left passes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from scaling_service.discovery.additions import Sized
from scaling_service.discovery.candidates import Masked
from scaling_service.discovery.choosing import chosen, tuned_name
from scaling_service.discovery.demands import forget
from scaling_service.discovery.findings import Findings, Foreign, Named
from scaling_service.discovery.fitting import Account, Recording, account, scene_of
from scaling_service.discovery.foreign import foreign
from scaling_service.discovery.hindsight import looked_back
from scaling_service.discovery.options import Options, look
from scaling_service.discovery.pairs import two_of_one_marker, two_of_one_plate
from scaling_service.discovery.refining import ROUGHLY, refined
from scaling_service.discovery.rivals import Naming, revisited
from scaling_service.discovery.strangers import stranger
from scaling_service.discovery.strictness import DiscoverySettings
from scaling_service.discovery.sufficient import without_the_insufficient
from scaling_service.discovery.telling import told
from scaling_service.discovery.trying import tried_in_full
from scaling_service.models.body import BodyModel

Progress = Callable[[str, float], None]


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
    named, now, options, odd_law = _searched(now, recordings, settings, report)
    report("looking back", 0.85)
    if named or odd_law is None:  # nothing is named in the stead of a law that no effect has
        named, now = two_of_one_plate(named, now, _naming(recordings, options, settings))
    named, now = looked_back(named, now, before, recordings, scene_of(before), settings)
    named, now, said = without_the_insufficient(
        named, now, before, recordings, scene_of(before), settings.stretch_s
    )
    now, seen = _unmasked(now, recordings)
    report("measuring the gap", 0.9)
    findings = told(named, options, odd_law, before, now, seen, recordings, settings, (*notes, *said))
    forget()
    report("done", 1.0)
    return Discovery(findings, before, now)


def _searched(
    now: Account, recordings: Sequence[Recording], settings: DiscoverySettings, report: Progress
) -> tuple[list[Named], Account, Options, Foreign | None]:
    """Round after round: what was named, the account with it, and what the last round saw."""
    named: list[Named] = []
    refused: set[str] = set()
    early: set[str] = set()  # refused until more is known of the forces
    options: Options | None = None
    while True:
        report(f"looking for effect {len(named) + 1}", min(0.8, 0.8 * len(named) / settings.most))
        options = look(now, scene_of(now), settings.stretch_s, settings.shortlist, options)
        naming = _naming(recordings, options, settings)
        found = chosen(now, options, named, refused, settings)
        odd_law = foreign(now, options, settings)
        if odd_law is not None:
            return named, now, options, odd_law
        masked = [e for e in now.effects if isinstance(e.candidate.change, Masked)]
        odd = stranger(now, options, settings) if len(masked) < settings.strangers else None
        pair = [] if odd is None else two_of_one_marker(odd, now, naming, refused)
        if odd is not None and not pair:
            left_out = Sized(odd.candidate, np.zeros(0))
            now = account(now.model, recordings, now.free, (*now.effects, left_out), now)
            continue
        found = pair or found
        if not found:
            return named, now, options, None
        tried = tried_in_full(now, found, recordings, settings)
        now = tried.account
        early |= tried.early
        refused |= tried.refused | early
        if any(n.effect.candidate.of_forces for n in tried.added):
            refused -= early
            early.clear()
        if tried.added:
            named, now = revisited([*named, *tried.added], now, naming)


def _naming(recordings: Sequence[Recording], options: Options, settings: DiscoverySettings) -> Naming:
    return Naming(
        recordings, settings, options.count, partial(tuned_name, options=options, settings=settings)
    )


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
