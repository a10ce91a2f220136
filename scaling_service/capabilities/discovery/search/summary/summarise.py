"""What a search found, with its gaps and limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scaling_service.capabilities.discovery.disturbances.disturbance import Disturbance
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.noise_floors import measure_noise_floors
from scaling_service.capabilities.discovery.evidence.scoring import ScoredCandidates
from scaling_service.capabilities.discovery.evidence.wrench import OBSERVATIONS
from scaling_service.capabilities.discovery.observations.tracked import ROLES
from scaling_service.capabilities.discovery.search.findings import Findings, NamedEffect, Verdict
from scaling_service.capabilities.discovery.search.summary.disagreements import locate_disagreements
from scaling_service.capabilities.discovery.search.summary.gaps import measure_gaps
from scaling_service.capabilities.discovery.search.summary.unexplained import describe_unexplained

_DISTURBED = (
    "the recordings follow a law that the catalogue does not have, clearly better than any that it has: "
    "repair what it describes and search again"
)
_SPENT = "{} effects of one kind were named, the most that are looked for"
_NOTHING_MORE = "nothing in the catalogue explains what is left better than chance"


def summarise(
    named: Sequence[NamedEffect],
    scored: ScoredCandidates,
    disturbance: Disturbance | None,
    fits: tuple[Fit, Fit, Fit],
    notes: Sequence[str],
) -> Findings:
    """Where, what, how far the gap closed, and what is left.

    Parameters
    ----------
    fits : tuple of Fit
        Before, after, and as after but with the motion as it is without the markers that move independently.
    """
    before, after, seen = fits
    settings, moving = before.settings, before.scene.moving
    floors = measure_noise_floors(after, moving)
    places = locate_disagreements(before, floors)
    usual = floors if seen is after else measure_noise_floors(seen, moving)
    left = describe_unexplained(seen, usual, disturbance)
    verdict: Verdict = "found" if named else "unexplained" if left else "nothing"
    folds = not any(item.role == "held_out" for item in before.tracked)
    roles = ROLES[:1] if folds else ROLES
    by_role = measure_gaps(named, before, after, roles, floors)
    spent = any(sum(o.shows(n.candidate) for n in named) >= settings.most for o in OBSERVATIONS)
    ended = _SPENT.format(settings.most) if spent else _NOTHING_MORE
    return Findings(
        verdict=verdict,
        disagreements=places,
        named=tuple(named),
        fit=by_role[roles[0]],
        held_out=by_role[roles[-1]],
        folds=folds,
        tried=tuple(o for o in scored.best if o.candidate.key not in {n.key for n in named}),
        unexplained=left,
        reason=_DISTURBED if disturbance else ended,
        notes=(*notes, *_describe_limits(before, folds), *([_DISTURBED] if disturbance else [])),
    )


def _describe_limits(before: Fit, folds: bool) -> tuple[str, ...]:
    said = []
    if folds:
        said.append(
            "no trial was held out: effects were tried on blocks of time between those that fitted them"
        )
    longest = max(float(np.ptp(item.trial.times)) for item in before.tracked)
    if len(before.tracked) == 1 and longest < 5.0:
        undecided = "what changes from trial to trial, and small effects, cannot be decided"
        said.append(f"one trial of {longest:.1f} s: {undecided}")
    return tuple(said)
