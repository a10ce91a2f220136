"""The search for what a model does not have, from the subject file to results; and on a virtual person."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from scaling_service.capabilities.discovery.bones import learn_bones, without_undetermined
from scaling_service.capabilities.discovery.evidence.settings import DiscoverySettings
from scaling_service.capabilities.discovery.models import correct_model
from scaling_service.capabilities.discovery.options import AS_MEASURED, PLAIN, DiscoverSettings
from scaling_service.capabilities.discovery.result import DiscoverResults, HiddenDocument
from scaling_service.capabilities.discovery.search.discover import discover as search_effects
from scaling_service.capabilities.discovery.search.naming import Origin
from scaling_service.capabilities.discovery.start import PLAIN_METHODS, prepare
from scaling_service.capabilities.discovery.telling import make_discovery_document
from scaling_service.capabilities.shared.names import AS_IT_IS
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core.progress import Progress, report_part, show_nothing
from scaling_service.model.subject import Subject
from scaling_service.virtual.example import RECORDED, make_hidden_session
from scaling_service.virtual.subject import VirtualSettings

USUAL = DiscoverySettings()
"""How strict the search is by default."""

_PREPARING = 0.2
"""Chosen: about the share of reading and scaling; the search takes the rest."""


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
    subject : Subject or path
        A subject, or the subject file that describes it.
    chosen : DiscoverSettings
        Which scaling to start from, and the inertia.
    settings : Settings
        Recordings are taken as measured, neither smoothed nor filled, unless it says otherwise.
    search : DiscoverySettings
        How strict the search is.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    DiscoverResults
        The effects with their sizes, what speaks for each, and how much of the gap they close on
        recordings that did not fit them.

    Raises
    ------
    InputError
        Something in the subject file, the model, the recordings or their forces cannot be used; or the model
        does not fit the recordings at all.

    Examples
    --------
    >>> import scaling_service as ss
    >>> found = ss.discover("plates/subject.json", ss.DiscoverSettings(start="none"))
    >>> found.document.verdict  # nothing is hidden in these recordings
    'nothing'
    """
    clock = time.perf_counter()
    report = progress or show_nothing
    report("reading the recordings", 0.0)
    loaded = open_subject(subject, settings, facing=True)
    return run(loaded, chosen, settings, search=search, progress=report, started=clock)


def run(
    loaded: Loaded,
    chosen: DiscoverSettings = PLAIN,
    settings: Settings = AS_MEASURED,
    *,
    search: DiscoverySettings = USUAL,
    progress: Progress | None = None,
    started: float | None = None,
) -> DiscoverResults:
    """Search in what is loaded already; see :func:`discover`.

    ``started``: value of ``time.perf_counter()`` from which the wall time counts.
    """
    clock = time.perf_counter() if started is None else started
    report = progress or show_nothing
    with loaded.blame_files():
        prepared = prepare(loaded, chosen, settings, report_part(report, 0.0, _PREPARING))
        found = search_effects(
            prepared.model,
            prepared.recordings,
            search,
            progress=report_part(report, _PREPARING, 1.0 - _PREPARING),
            notes=prepared.notes,
            origin=Origin(
                given=prepared.calibration is None,
                placed=prepared.start not in PLAIN_METHODS,
                declared_kg=prepared.subject.mass_kg,
            ),
        )
        lasting, left_out = without_undetermined(found.after, found)
        bones = learn_bones(correct_model(lasting), lasting)
    report("done", 1.0)
    return DiscoverResults(
        prepared=prepared,
        before=found.before,
        after=found.after,
        lasting=lasting,
        bones=bones,
        leanings=found.leanings,
        document=make_discovery_document(
            found, prepared, bones, left_out, chosen, settings, time.perf_counter() - clock
        ),
    )


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
    truth = []
    for h in hidden:
        trials, parameters = None if h.trial is None else [h.trial], dict(h.parameters)
        where, driver = list(h.where), list(h.driver)
        truth.append(
            HiddenDocument(kind=h.kind, where=where, driver=driver, trials=trials, parameters=parameters)
        )
    return replace(results, document=results.document.model_copy(update={"hidden": truth}))
