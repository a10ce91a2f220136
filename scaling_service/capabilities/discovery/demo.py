"""The search on a virtual person in whose recordings something is hidden."""

from __future__ import annotations

from dataclasses import replace

from scaling_service.capabilities.discovery.document import HiddenDocument
from scaling_service.capabilities.discovery.options import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.discovery.result import DiscoverResults
from scaling_service.capabilities.discovery.run import run
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.capabilities.subject.loading import Loaded
from scaling_service.core.progress import Progress, show_nothing
from scaling_service.virtual.example import RECORDED, make_hidden_session
from scaling_service.virtual.subject import VirtualSettings


def run_hidden_demo(
    seed: int = 0, settings: VirtualSettings = RECORDED, *, progress: Progress | None = None
) -> DiscoverResults:
    """Hide something in a person that the seed decides, and search for it without knowing what."""
    report = progress or show_nothing
    report("recording a virtual person", 0.0)
    session, _person, hidden = make_hidden_session(seed, settings)
    results = run(
        Loaded(session=session),
        DiscoverSettings(start=AS_IT_IS),
        AS_MEASURED.model_copy(update={"seed": seed}),
        progress=report,
    )
    truth = [
        HiddenDocument(
            kind=h.kind,
            where=list(h.where),
            driver=list(h.driver),
            trials=None if h.trial is None else [h.trial],
            parameters=dict(h.parameters),
        )
        for h in hidden
    ]
    return replace(results, hidden=truth)
