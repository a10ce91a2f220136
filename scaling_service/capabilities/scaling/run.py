"""Scaling and comparing, from a subject to results in memory, whoever asks for it."""

from __future__ import annotations

import math
import time
from collections import abc
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

from scaling_service.capabilities.motion.run import follow_rotations
from scaling_service.capabilities.motion.stops import describe_stops
from scaling_service.capabilities.scaling import result
from scaling_service.capabilities.scaling.comparison import geometry
from scaling_service.capabilities.scaling.departures import state_departures
from scaling_service.capabilities.scaling.following import FITTING, follow_trials
from scaling_service.capabilities.scaling.methods import table
from scaling_service.capabilities.scaling.muscles.compare import compare_muscles
from scaling_service.capabilities.scaling.muscles.parameters import keep_ranges
from scaling_service.capabilities.scaling.muscles.surface import follow_surfaces
from scaling_service.capabilities.scaling.options import ComparisonOptions
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.checks import require_landmarks
from scaling_service.capabilities.subject.loading import open_subject
from scaling_service.capabilities.subject.preparing import Loaded
from scaling_service.core import progress as progressing
from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.documents.results import TruthDocument
from scaling_service.files.osim.models import render_several, request_osim
from scaling_service.model import builtin
from scaling_service.model import subject as subjects
from scaling_service.model.anatomy.lengths import measure_segment_lengths
from scaling_service.model.freed import hold_markers
from scaling_service.model.results import Calibration
from scaling_service.model.scaling import scale_model
from scaling_service.virtual.example import make_demo_session

_LOADING = 0.1  # chosen: about the share of reading and processing in a comparison of short trials
_MUSCLES = 0.2  # chosen: about the share of the muscles, where they are compared

_BONES = 0.3  # chosen: about the share of making bones and reading their landmarks in the whole
_STEPS = 10  # of five bones: making them, finding their landmarks


def scale(
    subject: subjects.Subject | str | Path,
    method: str = "MB_am",
    settings: Settings = Settings(),
    *,
    progress: progressing.Progress | None = None,
) -> result.Results:
    """Scale a subject's model by one method.

    Parameters
    ----------
    subject : Subject or path
        A subject, or the subject file that describes it.
    method : str
        ``MB``, ``MB_lam``, ``MB_am``, ``EB``, ``EB_am`` (Puchaud et al. 2019, table 1), ``MAP`` (the joint
        posterior), or the name of one that another distribution adds.
    settings : Settings
        How recordings are processed and models fitted.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    Results
        With one scaling.

    Raises
    ------
    InputError
        Something in the subject file, the model or the recordings cannot be used.

    Examples
    --------
    >>> import scaling_service as ss
    >>> results = ss.scale("lab/subject.json", "MB")
    >>> lengths = results.lengths.to_frame().set_index("segment")["length_mm"]
    >>> round(float(lengths["femur_r"]), -1)  # truth: 418.9 mm
    420.0
    """
    return compare(subject, (method,), settings, progress=progress)


def compare(
    subject: subjects.Subject | str | Path,
    methods: abc.Sequence[str] | None = None,
    settings: Settings = Settings(),
    options: ComparisonOptions = ComparisonOptions(),
    *,
    progress: progressing.Progress | None = None,
) -> result.Results:
    """Scale a subject's model by several methods.

    Parameters
    ----------
    subject : Subject or path
        A subject, or the subject file that describes it.
    methods : sequence of str, optional
        As in :func:`scale`; all that the recordings allow unless given.
    settings : Settings
        How recordings are processed and models fitted.
    options : ComparisonOptions
        What is compared beside lengths, errors and angles: muscles, of ``.osim`` models.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    Results
        A scaling for each method, tables over all of them, and the verdict.

    Raises
    ------
    InputError
        Something in the subject file, the model or the recordings cannot be used.

    Examples
    --------
    >>> import scaling_service as ss
    >>> results = ss.compare("lab/subject.json", ["MB", "EB"])
    >>> list(results.scalings)
    ['MB', 'EB']
    >>> results.errors.columns
    ('method', 'trial', 'role', 'mean_mm', 'sd_mm', 'rms_mm', 'max_mm')
    """
    clock = time.perf_counter()
    report = progress or progressing.show_nothing
    table.check_methods(methods or ())
    report("reading the recordings", 0.0)
    loaded = open_subject(subject, settings, rotations=True)
    return run(loaded, methods, settings, options, progress=report, started=clock)


def run(
    loaded: Loaded,
    methods: abc.Sequence[str] | None = None,
    settings: Settings = Settings(),
    options: ComparisonOptions = ComparisonOptions(),
    *,
    progress: progressing.Progress | None = None,
    started: float | None = None,
) -> result.Results:
    """Scale by several methods what is loaded already; see :func:`compare`.

    ``started``: value of ``time.perf_counter()`` from which the wall time counts.
    """
    clock = time.perf_counter() if started is None else started
    session = loaded.session
    chosen, warnings = (tuple(dict.fromkeys(methods)), ()) if methods else _choose_possible(session)
    turned = settings.up is not None
    report = progress or progressing.show_nothing
    calibrations: dict[str, Calibration] = {}
    scalings: dict[str, result.Scaling] = {}
    with loaded.blame_files():
        if session.scale_setup is None and session.images is None and not session.unmarked:
            require_landmarks(session)
        scaling = 1.0 - _LOADING - (_MUSCLES if options.muscles else 0.0)
        for k, method in enumerate(chosen):
            share = scaling / len(chosen)
            part = progressing.report_part(report, _LOADING + share * k, share)
            part(f"{method}: fitting", 0.0)
            found = table.calibrate(
                session, method, settings.calibration, calibrations, _report_steps(part, method)
            )
            scalings[method] = follow_trials(with_mass(found, session), session, part)
            followed, notes = follow_rotations(scalings[method].calibration.model, session, turned=turned)
            scalings[method] = replace(scalings[method], followed=followed)
            warnings = tuple(dict.fromkeys((*warnings, *map(str, notes))))
            if options.muscle_points == "surface":
                scalings[method] = _put_on_surfaces(scalings[method], session)
            if options.muscle_parameters == "range":
                scalings[method] = _keep_ranges(scalings[method], session)
    scalings = state_departures(scalings)
    results = result.Results(
        loaded=loaded, settings=settings, scalings=scalings, subject_file=loaded.file, options=options
    )
    if options.muscles:
        with loaded.blame_files():
            results = _with_muscles(results, progressing.report_part(report, 1.0 - _MUSCLES, _MUSCLES))
    report("done", 1.0)
    doubtful = geometry.list_doubts(
        {method: scaling.errors for method, scaling in scalings.items()},
        {method: scaling.geometry.lengths for method, scaling in scalings.items()},
        session.subject.height_m,
    )
    advised = results.scalings[results.verdict.method]
    stops = describe_stops(advised.calibration.model, advised.motions)
    return replace(
        results,
        warnings=(*session.warnings, *warnings, *doubtful, *stops),
        wall_s=time.perf_counter() - clock,
    )


def _with_muscles(results: result.Results, progress: progressing.Progress) -> result.Results:
    """The results with what each method makes of the muscles, on held-out trials where there are some."""
    session = results.session
    scalings = dict(results.scalings)
    bare = [name for name, scaling in scalings.items() if scaling.osim is None]
    for name, text in zip(bare, render_scaled([scalings[n].calibration for n in bare], session), strict=True):
        scalings[name] = replace(scalings[name], osim=_expect_text(text))
    trials = results.held_out or tuple(trial.name for trial in session.dynamic)
    models = {name: (s.calibration.model, s.osim or "") for name, s in scalings.items()}
    motions = {name: s.motions for name, s in scalings.items()}
    found = compare_muscles(results.loaded, models, motions, trials, progress)
    return replace(results, scalings=scalings, muscles=found)


def _put_on_surfaces(scaling: result.Scaling, session: subjects.Session) -> result.Scaling:
    """The scaling with muscles attached where the person's bones are, if it lies on bones."""
    calibration = scaling.calibration
    source = _find_muscles(session, "no muscles can follow the bones", "--muscle-points")
    if session.images is None or not calibration.image_poses:
        return scaling
    found = follow_surfaces(
        _expect_text(*render_scaled([calibration], session)), calibration, session.images.bones, source
    )
    noted = replace(calibration, warnings=(*calibration.warnings, *found.notes))
    return replace(scaling, calibration=noted, osim=found.osim, attachments=found.moved)


def _keep_ranges(scaling: result.Scaling, session: subjects.Session) -> result.Scaling:
    """The scaling with fibres that work over the range that they have in the generic model."""
    calibration = scaling.calibration
    source = _find_muscles(session, "no fibres can keep their range", "--muscle-parameters")
    text = scaling.osim or _expect_text(*render_scaled([calibration], session))
    osim, kept = keep_ranges(text, hold_markers(calibration.model), source)
    said = (f"fibres and tendons kept their ratio of {', '.join(kept)}",) if kept else ()
    noted = replace(calibration, warnings=(*calibration.warnings, *said))
    return replace(scaling, calibration=noted, osim=osim)


def _find_muscles(session: subjects.Session, refused: str, flag: str) -> Path:
    """The subject's model file, which has muscles."""
    if not session.subject.model.lower().endswith(".osim"):
        raise SubjectInvalid(
            f"{refused}: the subject's model is no .osim model",
            field="model",
            remedy=f"Give an .osim model with muscles, or leave out {flag}",
        )
    return Path(session.subject.model)


def _expect_text(found: str | InputError) -> str:
    if isinstance(found, InputError):
        raise found
    return found


def render_scaled(
    calibrations: abc.Sequence[Calibration], session: subjects.Session
) -> list[str | InputError]:
    """The text of each scaled model's file for OpenSim, or why there is none.

    Markers that skin moves with joints stand there where they are in the neutral pose. Raises FileUnreadable:
    OpenSim crashed.
    """
    if not calibrations:
        return []
    return render_several([_request_scaled(calibration, session) for calibration in calibrations])


def _request_scaled(calibration: Calibration, session: subjects.Session) -> dict[str, Any]:
    subject, setup = session.subject, session.scale_setup
    model = hold_markers(calibration.model)
    if not subject.model.lower().endswith(".osim"):
        return request_osim(model)
    return request_osim(
        model,
        source=Path(subject.model),
        factors=calibration.scale_factors,
        axis_tilts=calibration.axis_tilts,
        joint_moves=calibration.joint_moves,
        marker_set=subject.marker_set,
        preserve_mass_distribution=setup is None or setup.preserve_mass_distribution,
        inertia_from_model=True,
    )


def _choose_possible(session: subjects.Session) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The methods that bones and recordings allow, and a note on those that trials are missing for."""
    if session.unmarked:
        return ("MB",), ()
    imaged = {n: m for n, m in table.METHODS.items() if session.images is not None or not m.needs_images}
    if session.calibration:
        return tuple(imaged), ()
    left_out = [name for name, method in imaged.items() if method.needs_movements]
    note = f"there is no calibration trial, so {', '.join(left_out)} were left out"
    return tuple(name for name in imaged if name not in left_out), (note,)


def _report_steps(part: progressing.Progress, method: str) -> abc.Callable[[int, float], None]:
    """Steps of a fit as progress: how many are needed is not known, so each adds less."""

    def step(number: int, _cost: float) -> None:
        part(f"{method}: fitting, step {number}", FITTING * (1.0 - 0.9**number))

    return step


def with_mass(calibration: Calibration, session: subjects.Session) -> Calibration:
    """The calibration with the person's mass on its model; unchanged where that is not known.

    An OpenSim model is the whole body, so its segments together take the person's mass, as OpenSim's
    scale tool has it (and its set-up's mass, where the subject file gives none). A built-in model may be a
    part of a body: it takes the same share of the person's mass as of its generic person's.
    """
    subject, own = session.subject, sum(segment.mass for segment in calibration.model.segments)
    if own <= 0.0:
        total = None
    elif subject.mass_kg is None:
        total = None if session.scale_setup is None else session.scale_setup.mass_kg
    elif subject.model in builtin.BUILTIN_NAMES:
        total = subject.mass_kg * own / builtin.load_generic_person(subject.model).mass_kg
    else:
        total = subject.mass_kg
    if total is None:
        return calibration
    return replace(calibration, model=scale_model(calibration.model, {}, mass_kg=total))


def run_demo(
    settings: Settings = Settings(), *, progress: progressing.Progress | None = None
) -> tuple[result.Results, TruthDocument]:
    """Scale a virtual person, bones imaged, by every method, and measure each against the truth.

    ``settings``: its seed decides the person.
    Distances from the truth are taken on the gait trials, which no method was fitted to.
    """
    report, steps = progress or progressing.show_nothing, count()
    session, person = make_demo_session(
        settings.seed,
        images=True,
        progress=lambda what: report(what, _BONES * min(1.0, next(steps) / _STEPS)),
    )
    results = run(
        Loaded(session=session),
        None,
        settings,
        progress=progressing.report_part(report, _BONES, 1 - _BONES),
    )
    lengths = {name: 1e3 * value for name, value in measure_segment_lengths(person.model).items()}
    errors = {}
    for method, scaling in results.scalings.items():
        model = scaling.calibration.model
        held_out = [scaling.motions[trial.name] for trial in results.session.evaluation]
        off = geometry.compute_length_errors(model, person.model).values()
        found = {"lengths_mm": 1e3 * sum(map(abs, off)) / len(off)}
        for name, gap in geometry.compute_centre_errors(
            model, held_out, person.model, person.motions
        ).items():
            found[f"{name}_centre_mm"] = 1e3 * gap
        for name, gap in geometry.compute_angle_errors(held_out, person.model, person.motions).items():
            found[f"{name}_deg"] = math.degrees(gap)
        errors[method] = found
    return results, TruthDocument(segment_lengths_mm=lengths, errors=errors)
