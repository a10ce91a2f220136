"""What the search starts from: a model of the person, recordings as they were measured, and their forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from scaling_service.capabilities.discovery.evidence.fit import Recording
from scaling_service.capabilities.discovery.fit import check_fits
from scaling_service.capabilities.discovery.forces import Footings, footings
from scaling_service.capabilities.discovery.free import free_of
from scaling_service.capabilities.discovery.laws.candidates import Estimate
from scaling_service.capabilities.discovery.limits import check_lengths, limits
from scaling_service.capabilities.discovery.settings import AS_MEASURED, DiscoverSettings
from scaling_service.capabilities.dynamics.start import Massive, with_inertia
from scaling_service.capabilities.scaling import run as tasks
from scaling_service.capabilities.shared.names import AS_IT_IS, OWN
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.loading import Loaded, load
from scaling_service.capabilities.subject.reading import blamed_on, load_subject, recordings
from scaling_service.core.errors import TrialUnusable
from scaling_service.core.progress import Progress
from scaling_service.model.body import BodyModel
from scaling_service.model.results import Calibration
from scaling_service.model.subject import Subject
from scaling_service.recording.orientation import check_axes


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Everything that the search needs, in memory.

    Parameters
    ----------
    loaded : Loaded
    start : str
        The method that scaled the model, or ``none``.
    model : BodyModel
        Of the person's size, without parameters.
    recordings : tuple of Recording
        Calibration trials fit, evaluation trials are held out; all fit where there are only one kind.
    free : tuple of Sized
        What the calibration could have explained, at zero.
    forces : Footings
    calibration : Calibration, optional
        None for the given model.
    notes : tuple of str
        What could not be tried or decided, and why.
    """

    loaded: Loaded
    start: str
    model: BodyModel
    recordings: tuple[Recording, ...]
    free: tuple[Estimate, ...] = ()
    forces: Footings = field(default_factory=Footings)
    calibration: Calibration | None = None
    notes: tuple[str, ...] = ()

    @property
    def subject(self) -> Subject:
        """Whose."""
        return self.loaded.session.subject

    @property
    def roles(self) -> Mapping[str, str]:
        """Recording to ``fit`` or ``held_out``."""
        return {r.trial.name: r.role for r in self.recordings}


def read(subject: Subject | str | Path, settings: Settings = AS_MEASURED) -> Loaded:
    """Read a subject's model and recordings for the search.

    Raises
    ------
    InputError
        Whatever in the subject file, the model or the recordings cannot be used.
    """
    file = None if isinstance(subject, Subject) else Path(subject)
    check_axes(settings.up, settings.forward)
    known = subject if isinstance(subject, Subject) else load_subject(Path(subject))
    with blamed_on(file):
        return load(known, settings)


def prepare(
    loaded: Loaded,
    chosen: DiscoverSettings,
    settings: Settings,
    block_s: float,
    progress: Progress | None = None,
) -> Prepared:
    """Scale the model, read the forces, and look whether the model follows the recordings at all.

    Parameters
    ----------
    loaded : Loaded
        Recordings neither smoothed nor filled.
    chosen : DiscoverSettings
    settings : Settings
    block_s : float
        Length of the stretches of time that count as independent, s.
    progress : callable, optional

    Raises
    ------
    InputError
        Whatever in the model, the recordings or their forces cannot be used; the model does not fit at all.
    """
    session = loaded.session
    if not session.dynamic:
        raise TrialUnusable(
            "there is no movement to compare with the model",
            field="trials",
            remedy="Name recordings under `calibration:` and `evaluation:`",
        )
    with blamed_on(None, recordings(session.subject)):
        check_lengths(session.dynamic)
        method = chosen.start or ("EB_am" if session.images is not None else "MB_am")
        calibration, warnings = _calibrated(loaded, method, settings, progress)
        model = session.model if calibration is None else calibration.model
        check_fits(model, session.dynamic)
        massive = _massive(model, session.subject, chosen.inertia, scaled=calibration is not None)
        forces = footings(loaded, session.subject, massive.model, chosen.cutoff_hz)
        used = _recordings(loaded, forces)
        free = (
            () if calibration is None else free_of(method, model, session.calibration, settings.calibration)
        )
    notes = (
        *warnings,
        *(massive.notes if forces.by_trial else ()),
        *forces.notes,
        *limits(used, block_s),
    )
    return Prepared(
        loaded, method, massive.model, used, free, forces, calibration, tuple(dict.fromkeys(notes))
    )


def _calibrated(
    loaded: Loaded, method: str, settings: Settings, progress: Progress | None
) -> tuple[Calibration | None, tuple[str, ...]]:
    if method == AS_IT_IS:
        return None, loaded.session.warnings
    results = tasks.run(loaded, (method,), settings, progress=progress)
    calibration = results.scalings[method].calibration
    return calibration, (*results.warnings, *calibration.warnings)


def _massive(model: BodyModel, subject: Subject, inertia: str | None, *, scaled: bool) -> Massive:
    """With inertia; a person of whom too little is known for a table keeps the model's own."""
    known = None not in (subject.sex, subject.height_m, subject.mass_kg)
    if inertia is None and not known:
        note = "sex, height_m or mass_kg is not given: the model's own inertia was taken"
        return Massive(model, OWN, (note,) if scaled else ())
    return with_inertia(model, subject, inertia, scaled=scaled)


def _recordings(loaded: Loaded, forces: Footings) -> tuple[Recording, ...]:
    session = loaded.session
    fitting = {t.name for t in session.calibration} or {t.name for t in session.evaluation}
    return tuple(
        Recording(t, "fit" if t.name in fitting else "held_out", forces.by_trial.get(t.name))
        for t in session.dynamic
    )
