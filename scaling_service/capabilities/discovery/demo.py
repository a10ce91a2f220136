"""The search on a virtual person in whose recordings something is hidden."""

from __future__ import annotations

from dataclasses import replace

from scaling_service.capabilities.discovery.document import HiddenDocument
from scaling_service.capabilities.discovery.run import DiscoverResults, run
from scaling_service.capabilities.discovery.settings import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.progress import Progress
from scaling_service.virtual.example import RECORDED, Hidden, hidden_session
from scaling_service.virtual.subject import VirtualSettings


def run_hidden_demo(
    seed: int = 0, settings: VirtualSettings = RECORDED, *, progress: Progress | None = None
) -> DiscoverResults:
    """Hide something, and search for it without knowing what.

    Parameters
    ----------
    seed : int
        Decides the person.
    settings : VirtualSettings
        What is recorded.
    progress : callable, optional

    Returns
    -------
    DiscoverResults
        What was hidden stands beside what was found.
    """
    if progress is not None:
        progress("recording a virtual person", 0.0)
    session, _person, hidden = hidden_session(seed, settings)
    results = run(
        Loaded(session),
        DiscoverSettings(start=AS_IT_IS),
        AS_MEASURED.model_copy(update={"seed": seed}),
        progress=progress,
    )
    return replace(results, hidden=tuple(map(_document, hidden)))


def _document(hidden: Hidden) -> HiddenDocument:
    return HiddenDocument(
        kind=hidden.kind,
        where=list(hidden.where),
        driver=list(hidden.driver),
        trials=None if hidden.trial is None else [hidden.trial],
        parameters=dict(hidden.parameters),
    )
