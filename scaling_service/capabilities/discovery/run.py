"""The search for what a model does not have, from the subject file to results in memory."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scaling_service.capabilities.discovery.document import HiddenDocument
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.search.discover import discover as searched
from scaling_service.capabilities.discovery.search.findings import Findings
from scaling_service.capabilities.discovery.settings import AS_MEASURED, PLAIN, DiscoverSettings
from scaling_service.capabilities.discovery.start import Prepared, prepare, read
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.capabilities.subject.reading import blamed_on, recordings
from scaling_service.core.progress import Progress
from scaling_service.model.subject import Subject

USUAL = DiscoverySettings()
"""How strict the search is unless told otherwise."""

_PREPARING = 0.2
"""Chosen: about the share of reading and scaling; the search takes the rest."""


@dataclass(frozen=True, slots=True, eq=False)
class DiscoverResults:
    """What a search made of a subject's recordings.

    Parameters
    ----------
    prepared : Prepared
    chosen : DiscoverSettings
    settings : Settings
    search : DiscoverySettings
    findings : Findings
    before, after : Account
        The recordings as followed without and with what was named.
    wall_s : float
    subject_file : Path, optional
    hidden : sequence of HiddenDocument, optional
        Of a virtual person: what the search should have found.
    """

    prepared: Prepared
    chosen: DiscoverSettings
    settings: Settings
    search: DiscoverySettings
    findings: Findings
    before: Fit
    after: Fit
    wall_s: float = 0.0
    subject_file: Path | None = None
    hidden: Sequence[HiddenDocument] | None = None


def discover(
    subject: Subject | str | Path,
    chosen: DiscoverSettings = PLAIN,
    settings: Settings = AS_MEASURED,
    *,
    search: DiscoverySettings = USUAL,
    progress: Progress | None = None,
) -> DiscoverResults:
    """Find where a subject's model and recordings disagree, and name what is missing.

    Parameters
    ----------
    subject : Subject or path of a subject file
    chosen : DiscoverSettings
    settings : Settings
        Recordings are taken as measured, neither smoothed nor filled, unless it says otherwise.
    search : DiscoverySettings
        How strict the search is.
    progress : callable, optional

    Raises
    ------
    InputError
        Whatever in the subject file, the model, the recordings or their forces cannot be used; or the model
        does not fit the recordings at all.
    """
    clock = time.perf_counter()
    report = progress or _silent
    report("reading the recordings", 0.0)
    file = None if isinstance(subject, Subject) else Path(subject)
    loaded = read(subject, settings)
    with blamed_on(file):
        return run(
            loaded,
            chosen,
            settings,
            search=search,
            progress=report,
            subject_file=file,
            started=clock,
        )


def run(
    loaded: Loaded,
    chosen: DiscoverSettings = PLAIN,
    settings: Settings = AS_MEASURED,
    *,
    search: DiscoverySettings = USUAL,
    progress: Progress | None = None,
    subject_file: Path | None = None,
    started: float | None = None,
) -> DiscoverResults:
    """Search in what is loaded already; see :func:`discover`.

    Parameters
    ----------
    started : float, optional
        Value of ``time.perf_counter()`` from which the wall time counts.
    """
    clock = time.perf_counter() if started is None else started
    report = progress or _silent
    prepared = prepare(
        loaded, chosen, settings, search.block_s, lambda what, share: report(what, _PREPARING * share)
    )
    with blamed_on(None, recordings(loaded.session.subject)):
        found = searched(
            prepared.model,
            prepared.recordings,
            prepared.free,
            search,
            progress=lambda what, share: report(what, _PREPARING + (1.0 - _PREPARING) * share),
            notes=prepared.notes,
        )
    report("done", 1.0)
    return DiscoverResults(
        prepared,
        chosen,
        settings,
        search,
        found.findings,
        found.before,
        found.after,
        time.perf_counter() - clock,
        subject_file,
    )


def _silent(what: str, share: float) -> None:
    """No progress is shown."""
