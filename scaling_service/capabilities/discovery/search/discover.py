"""Find what stands out of what is ordinary for people, and show what it was.

Labels first, then the body and its markers, then the weight and the forces. The likeliest is named, the
recordings are tracked anew with it, and so on until nothing has the odds. Nothing is named whose own places,
or whose forces or markers as a whole, are worse with it on what did not fit it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from scaling_service.capabilities.discovery import result as documents
from scaling_service.capabilities.discovery.effects.catalogue import find_effects
from scaling_service.capabilities.discovery.evidence.fit import (
    Fit,
    SearchContext,
    SearchTrial,
    fit_recordings,
)
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.observations.tracked import ROLES
from scaling_service.capabilities.discovery.ordinary.forces import ForceEvidence, WrenchTable
from scaling_service.capabilities.discovery.search.body import LABELS
from scaling_service.capabilities.discovery.search.findings import NamedEffect
from scaling_service.capabilities.discovery.search.forces import FORCES, Search
from scaling_service.capabilities.discovery.search.gaps import list_disagreements, measure_gap
from scaling_service.capabilities.discovery.search.leanings import Leanings
from scaling_service.capabilities.discovery.search.markers import BodyTable
from scaling_service.capabilities.discovery.search.naming import SHOWN, Origin, is_of_markers
from scaling_service.capabilities.discovery.search.separating import find_separating_movement
from scaling_service.capabilities.discovery.search.unexplained import list_unexplained
from scaling_service.capabilities.discovery.search.yardstick import make_yardstick
from scaling_service.core.progress import Progress, Steps, report_nothing, show_nothing
from scaling_service.model.body import BodyModel

_NOTHING_MORE = "nothing more stands out of what is ordinary for people"
_SPENT = "{} effects of one kind were named, the most that are looked for"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Discovery:
    """The whole story, and the two fits between which it goes."""

    disagreements: tuple[documents.DisagreementDocument, ...]  # the largest first
    named: tuple[NamedEffect, ...]
    fit: documents.GapDocument
    held_out: documents.GapDocument  # the same as ``fit`` where no trial was held out
    tried: tuple[documents.TriedDocument, ...]
    unexplained: tuple[documents.UnexplainedDocument, ...]
    reason: str  # why the search stopped
    notes: tuple[str, ...]  # what could not be tried and why
    before: Fit
    after: Fit
    leanings: Leanings = field(default_factory=Leanings)

    @property
    def verdict(self) -> documents.Verdict:
        """Whether anything was named that takes something off the gap, or at least stands out."""
        if any(named.carries for named in self.named):
            return "found"
        return "unexplained" if self.unexplained else "nothing"


def discover(
    model: BodyModel,
    recordings: Sequence[SearchTrial],
    settings: DiscoverySettings = DiscoverySettings(),
    progress: Progress | None = None,
    notes: Sequence[str] = (),
    origin: Origin | None = None,
) -> Discovery:
    """Search the catalogue for what the model does not have.

    Parameters
    ----------
    model : BodyModel
        Without parameters; with mass where forces are given.
    recordings : sequence of SearchTrial
        Not smoothed, not filled.
    notes : sequence of str
        What is known already of what could not be tried.

    Raises
    ------
    TrialUnusable
        A trial shows no marker of the model.
    """
    steps = Steps(report=progress or show_nothing)
    steps.begin("following the recordings", 0.0, LABELS)
    context = SearchContext(model=model, recordings=recordings, settings=settings, advance=steps.advance)
    search = Search(fit=fit_recordings(context), origin=origin or Origin(), steps=steps)
    search.find_labels()
    body = search.search_body()
    forces = search.search_forces()
    steps.begin("measuring the gap", FORCES, 1.0)
    # Followed alike, so that nothing but what is named lies between the two
    before = fit_recordings(context, (), search.fit) if search.fit.effects else search.fit
    # What is kept tells nobody of steps: who listens need not be where results are sent
    before, search.fit = (
        replace(fit, context=replace(context, advance=report_nothing)) for fit in (before, search.fit)
    )
    found = _summarise(search, before, body, forces, notes)
    steps.begin("done", 1.0, 1.0)
    return found


def _summarise(
    search: Search,
    before: Fit,
    body: BodyTable,
    forces: tuple[WrenchTable, ForceEvidence] | None,
    notes: Sequence[str],
) -> Discovery:
    """Where, what, how far the gap closed, and what is left."""
    after, settings = search.fit, search.settings
    yardstick = make_yardstick(body, after, forces)
    folds = not any(item.role == "held_out" for item in before.tracked)
    gaps = {role: measure_gap(before, after, role, yardstick) for role in (ROLES[:1] if folds else ROLES)}
    named = tuple(sorted((_finish(one, search) for one in search.named), key=_rank))
    unexplained = list_unexplained(search, body, forces, yardstick)
    spent = sum(is_of_markers(n.candidate) for n in named) >= settings.most
    taken = {n.key for n in named}
    tried = sorted((o for o in search.tried.items() if o[0] not in taken), key=lambda o: -o[1][0])
    said = ["no trial was held out: what is named was not tried on others"] if folds else []
    return Discovery(
        disagreements=list_disagreements(before, yardstick),
        named=named,
        fit=gaps[ROLES[0]],
        held_out=gaps[ROLES[0] if folds else ROLES[1]],
        tried=tuple(document for _, (_, document) in tried[:SHOWN]),
        unexplained=unexplained,
        reason=_SPENT.format(settings.most) if spent else _NOTHING_MORE,
        notes=(*notes, *said),
        before=before,
        after=after,
        leanings=search.join_leanings(body),
    )


def _rank(named: NamedEffect) -> tuple[bool, float]:
    """What is at fault in a recording first, for it is mended first; then what takes most off the gap."""
    return not find_effects()[named.candidate.kind].of_recording, -named.gain


def _finish(one: NamedEffect, search: Search) -> NamedEffect:
    """With its size and numbers as they are in the end."""
    effect, kind = search.fit.by_key[one.key], find_effects()[one.candidate.kind]
    return replace(
        one,
        effect=effect,
        covariance=search.covariances[one.key],
        would_separate=find_separating_movement(effect, tuple(one.equivalents), search.fit),
        details=kind.details(effect, search.fit),
        spreads=kind.spreads(effect, search.fit),
    )
