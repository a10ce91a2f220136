"""Everything of one subject into memory: the model, and the recordings ready to compute with."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from scaling_service.capabilities.subject.bone_evidence import gather
from scaling_service.capabilities.subject.checks import refuse_one_spot, refuse_repeated, require_measurements
from scaling_service.capabilities.subject.notes import notes
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import InputError, SubjectInvalid
from scaling_service.core.text import few
from scaling_service.files.model_json import SUFFIX, read_model_json
from scaling_service.files.osim import read_osim, read_scale_setup
from scaling_service.files.recording import read_recording
from scaling_service.model.anatomy.marker_sets import tracking_segments
from scaling_service.model.anatomy.markers import (
    LabelMap,
    canonical,
    looks_computed,
    match_labels,
    strip_prefix,
)
from scaling_service.model.body import BodyModel
from scaling_service.model.builtin import BUILTIN_NAMES, builtin
from scaling_service.model.subject import ScaleSetup, Session, Subject
from scaling_service.model.trial import MeasuredSizes, Repair, Trial, merge
from scaling_service.recording.orientation import Orientation, decide
from scaling_service.recording.pipeline import process
from scaling_service.recording.strays import without_strays

_LIMBS = ("femur", "tibia")
_FEWEST = 3  # markers without which a segment has no pose of its own


@dataclass(frozen=True, slots=True, eq=False)
class Loaded:
    """A session, and how its labels and axes were understood.

    Parameters
    ----------
    session : Session
    markers_used : mapping
        Model marker to the labels that were taken for it, one unless trials differ.
    axes : str
        Which laboratory axes were taken for up and forward.
    orientation : Orientation, optional
        The same as a rotation, for forces.
    """

    session: Session
    markers_used: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    axes: str = ""
    orientation: Orientation | None = None


def load(subject: Subject, settings: Settings = Settings()) -> Loaded:
    """Read the model and the recordings of a subject.

    Labels become the model's marker names, positions m with X forward, Y up and Z right, gaps are
    filled as the settings allow; everything that was changed is in each trial's ``repairs``.

    Raises
    ------
    InputError
        Whatever a file or a label is not fit for; it names the file and the remedy.
    """
    model = _without_computed(read_model(subject.model, subject.marker_set), subject)
    _check_segments(subject, model)
    paths = recordings(subject)
    raw = {path: _read(path) for path in paths}
    subject, of_sizes = with_stated_sizes(subject, raw)
    _check_explicit(subject, model, list(raw.values()))
    subject, of_tracking = with_tracking_markers(subject, model, raw)
    wanted = list(dict.fromkeys([*model.marker_names, *subject.extra_markers]))
    named = {path: _named(trial, wanted, subject, path) for path, trial in raw.items()}
    axes = _axes(named, subject.static, settings)
    clusters = _clusters(model, subject)
    ready: dict[Path, Trial] = {}
    for path, (trial, _) in named.items():
        with blamed_on(path, [path]):
            ready[path] = process(trial, axes, clusters, settings.processing)
            refuse_one_spot(model, ready[path])
    refuse_repeated(ready, subject)
    setup, told = _scale_setup(subject, model, ready)
    images, of_images = gather(subject, model)
    session = Session(
        subject,
        model,
        None if subject.static is None else ready[subject.static],
        tuple(ready[path] for path in subject.calibration),
        tuple(ready[path] for path in subject.evaluation),
        setup,
        (
            *of_sizes,
            *of_tracking,
            *told,
            *of_images,
            *notes(model, subject, [trial for trial, _ in named.values()]),
        ),
        images,
    )
    return Loaded(session, _used([mapped for _, mapped in named.values()], wanted), axes.description, axes)


def read_model(name_or_path: str | Path, marker_set: str | Path | None = None) -> BodyModel:
    """A built-in model by name, or by path an OpenSim model or one that this program wrote.

    Parameters
    ----------
    name_or_path : str or path
        Anything that ends in ``.osim`` or ``.json`` is a path.
    marker_set : path, optional
        OpenSim markers to add; ``.osim`` only.

    Raises
    ------
    InputError
        There is no such model, or it cannot be read or represented.
    """
    if str(name_or_path).lower().endswith(".osim"):
        with blamed_on(Path(name_or_path)):
            return read_osim(Path(name_or_path), None if marker_set is None else Path(marker_set))
    if str(name_or_path).lower().endswith(SUFFIX):
        with blamed_on(Path(name_or_path)):
            return read_model_json(name_or_path)
    return builtin(str(name_or_path))


def recordings(subject: Subject) -> tuple[Path, ...]:
    """The files of all trials, each once: static, calibration, evaluation."""
    static = () if subject.static is None else (subject.static,)
    return tuple(dict.fromkeys((*static, *subject.calibration, *subject.evaluation)))


def with_stated_sizes(subject: Subject, trials: Mapping[Path, Trial]) -> tuple[Subject, tuple[str, ...]]:
    """The subject with height, mass and sizes that its recordings state and its file does not.

    Returns
    -------
    subject : Subject
    notes : tuple of str
        What two of them state differently: the subject file counts before the recordings, then the first
        recording.
    """
    own = MeasuredSizes(subject.height_m, subject.mass_kg, subject.sizes_m)
    notes = tuple(
        f"{path.name} states another {name.replace('_', ' ')} than the subject file, which counts"
        for path, trial in trials.items()
        for name in own.conflicts(trial.sizes)
    )
    known = own.or_else(merge(trial.sizes for trial in trials.values()))
    completed = replace(
        subject, height_m=known.height_m, mass_kg=known.mass_kg, sizes_m=dict(known.lengths_m)
    )
    return completed, notes


def with_tracking_markers(
    subject: Subject, model: BodyModel, trials: Mapping[Path, Trial]
) -> tuple[Subject, tuple[str, ...]]:
    """The subject with tracking markers of its marker set on thighs and shanks that movements hardly show.

    A segment with fewer than three markers has no pose of its own; where the subject file names no extra
    markers, those whose place the set tells are taken. Only for built-in models: others bring their own.

    Returns
    -------
    subject : Subject
    notes : tuple of str
    """
    if subject.extra_markers or subject.model not in BUILTIN_NAMES:
        return subject, ()
    moving = [trial for path, trial in trials.items() if path != subject.static] or list(trials.values())
    labels = set(moving[0].labels).intersection(*(trial.labels for trial in moving[1:]))
    matched = match_labels(sorted(labels), model.marker_names, _explicit_in(subject, labels)).mapped
    carried = Counter(m.segment for m in model.markers if m.name in matched and m.weight > 0.0)
    known = tracking_segments(sorted(labels - set(matched.values())), model)
    added = {
        strip_prefix(label): segment
        for label, segment in known.items()
        if segment.startswith(_LIMBS) and carried[segment] < _FEWEST
    }
    if not added:
        return subject, ()
    note = f"{few(list(added))}: tracking markers of this marker set, used though no extra_markers name them"
    return replace(subject, extra_markers=added), (note,)


def _explicit_in(subject: Subject, labels: Iterable[str]) -> dict[str, str]:
    return {m: label for m, label in subject.marker_map.items() if _has(list(labels), label)}


@contextmanager
def blamed_on(file: Path | None, trials: Iterable[Path] = ()) -> Iterator[None]:
    """Let errors raised inside name a file.

    Parameters
    ----------
    file : Path, optional
        Named where an error names none.
    trials : iterable of Path
        Named where an error names the bare stem of one.
    """
    try:
        yield
    except InputError as error:
        by_stem = {path.stem: path for path in trials}
        found = file if error.file is None else by_stem.get(error.file)
        if found is not None:
            error.file = str(found)
        raise


def _read(path: Path) -> Trial:
    with blamed_on(path, [path]):
        return without_strays(read_recording(path))


def _without_computed(model: BodyModel, subject: Subject) -> BodyModel:
    """The model with points that other software computes from markers (joint centres) not to be followed.

    They may still be measured by a scale set-up, and are markers again where the subject file maps them.
    """
    return model.with_markers(
        tuple(
            replace(m, weight=0.0) if looks_computed(m.name) and m.name not in subject.marker_map else m
            for m in model.markers
        )
    )


def _scale_setup(
    subject: Subject, model: BodyModel, ready: Mapping[Path, Trial]
) -> tuple[ScaleSetup | None, tuple[str, ...]]:
    """The set-up, and what it scales in vain; its marker placer leaves the model's fixed markers alone."""
    if subject.scale_setup is None:
        return None, ()
    setup = read_scale_setup(subject.scale_setup)
    told: tuple[str, ...] = ()
    standing = next(iter(p for p in (subject.static, *subject.calibration) if p is not None), None)
    if standing is not None:
        with blamed_on(None, [standing]):
            told = tuple(require_measurements(setup, model, ready[standing], subject.scale_setup))
    if setup.placement is None:
        return setup, told
    fixed = frozenset(marker.name for marker in model.markers if marker.anatomical)
    return replace(setup, placement=replace(setup.placement, fixed=fixed)), told


def _check_segments(subject: Subject, model: BodyModel) -> None:
    for label, segment in subject.extra_markers.items():
        if segment not in model.segment_names:
            raise SubjectInvalid(
                f"model '{model.name}' has no segment '{segment}'",
                field=f"extra_markers.{label}",
                remedy=f"{_guess(segment, model.segment_names)}Its segments are "
                f"{', '.join(model.segment_names)}",
            )


def _check_explicit(subject: Subject, model: BodyModel, trials: Sequence[Trial]) -> None:
    """A marker that the subject file maps is the model's, and its label in at least one recording."""
    present = list(dict.fromkeys(label for trial in trials for label in trial.labels))
    for marker, label in subject.marker_map.items():
        if marker not in model.marker_names and marker not in subject.extra_markers:
            raise SubjectInvalid(
                f"the model has no marker '{marker}'",
                field=f"markers.{marker}",
                remedy=f"{_guess(marker, model.marker_names)}It has {', '.join(model.marker_names)}",
            )
        if not _has(present, label):
            raise SubjectInvalid(
                f"label '{label}' is in no recording",
                field=f"markers.{marker}",
                remedy=f"{_guess(label, [strip_prefix(p) for p in present])}Their labels are "
                f"{', '.join(present)}",
            )


def _guess(name: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, known, n=1)
    return f"Did you mean '{close[0]}'? " if close else ""


def _has(labels: Sequence[str], label: str) -> bool:
    return label in labels or label in map(strip_prefix, labels)


def _named(
    trial: Trial, wanted: Sequence[str], subject: Subject, path: Path
) -> tuple[Trial, Mapping[str, str]]:
    """A trial with the model's names in place of its labels, and which label was taken for which marker."""
    explicit = _explicit_in(subject, trial.labels)
    with blamed_on(path):
        found = match_labels(trial.labels, wanted, explicit)
        _refuse_rivals(found, explicit)
    # A label that happens to carry a marker's name, while the user mapped that marker to another one.
    shadowed = [label for label in found.unused_labels if label in found.mapped]
    kept = trial.selected([label for label in trial.labels if label not in shadowed])
    notes = [Repair("label", path.name, note) for note in found.notes]
    notes += [
        Repair("label", label, f"'{label}' was left out: the marker is another label") for label in shadowed
    ]
    renamed = kept.relabelled(found.renames)
    return replace(renamed, repairs=(*renamed.repairs, *notes)), found.mapped


def _refuse_rivals(found: LabelMap, explicit: Mapping[str, str]) -> None:
    """The same label with and without a prefix, or with two: they may be of two persons."""
    for marker, label in found.mapped.items():
        rivals = [other for other in found.unused_labels if strip_prefix(other) == strip_prefix(label)]
        if rivals and marker not in explicit:
            raise InputError(
                f"marker '{marker}' could be {' or '.join(repr(name) for name in (label, *rivals))}",
                field=f"markers.{marker}",
                remedy="Say under `markers:` in the subject file which label it is",
            )


def _axes(
    named: Mapping[Path, tuple[Trial, Mapping[str, str]]], static: Path | None, settings: Settings
) -> Orientation:
    """One decision for the session: up from its first recording, forward from how most movements face.

    A person may stand for the static trial in another direction than they walk; what matters for
    forces and the direction of progression is the movement.
    """
    decided: dict[Path, Orientation] = {}
    for path, (trial, _) in named.items():
        roles = {label: role for label in trial.labels if (role := canonical(label)) is not None}
        up = next(iter(decided.values())).up if decided else settings.up
        with blamed_on(path, [path]):
            decided[path] = decide(trial, roles=roles, up=up, forward=settings.forward)
    return agreed_axes(decided, static)


def agreed_axes(decided: Mapping[Path, Orientation], static: Path | None) -> Orientation:
    """One decision from those on each recording: up from the first, forward from how most movements face.

    Parameters
    ----------
    decided : mapping
        File to its own decision, at least one, all with the same up.
    static : Path, optional
        The recording of standing, which counts only where there is no other.
    """
    moving = [axes for path, axes in decided.items() if path != static] or list(decided.values())
    most, _ = Counter(axes.forward for axes in moving).most_common(1)[0]
    chosen = next(axes for axes in moving if axes.forward == most)
    why_up = [r for r in next(iter(decided.values())).repairs if r.what == "up_axis"]
    return replace(chosen, repairs=(*why_up, *(r for r in chosen.repairs if r.what != "up_axis")))


def _clusters(model: BodyModel, subject: Subject) -> dict[str, tuple[str, ...]]:
    """Segment to the labels on it, from which gaps of the others can be filled."""
    found: dict[str, list[str]] = {segment: [] for segment in model.segment_names}
    sides = {m.name: m.segment for m in model.markers if m.weight > 0.0} | dict(subject.extra_markers)
    for label, segment in sides.items():
        found[segment].append(label)
    return {segment: tuple(labels) for segment, labels in found.items() if labels}


def _used(maps: Sequence[Mapping[str, str]], wanted: Sequence[str]) -> dict[str, tuple[str, ...]]:
    every = {name: tuple(dict.fromkeys(m[name] for m in maps if name in m)) for name in wanted}
    return {name: labels for name, labels in every.items() if labels}
