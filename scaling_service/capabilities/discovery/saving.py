"""What a search found onto disk, with recordings freed of their faults: complete, or nothing at all."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from scaling_service.capabilities.discovery import models
from scaling_service.capabilities.discovery.evidence.fit import Fit
from scaling_service.capabilities.discovery.laws import apply
from scaling_service.capabilities.discovery.laws.candidates import Contact
from scaling_service.capabilities.discovery.observations.wrench import COMPONENTS
from scaling_service.capabilities.discovery.playing import write_discovery_scene
from scaling_service.capabilities.discovery.result import FILE_NAME, DiscoverResults, DiscoveryDocument
from scaling_service.capabilities.discovery.start import Prepared
from scaling_service.capabilities.discovery.words import describe_hidden, summarise
from scaling_service.capabilities.kinetics.forces import read_trial_forces, turn_forces
from scaling_service.capabilities.playback.scene import INSIDE
from scaling_service.core.progress import Progress, show_nothing
from scaling_service.documents import writing
from scaling_service.files.model_json import write_model_json
from scaling_service.files.sto import Table, write_sto
from scaling_service.files.trc import write_trc
from scaling_service.model.forces import GroundForces
from scaling_service.report.onefile import Report, collect_files

FOLDER = "corrected"

_NOTE = (
    f"{FOLDER}/ holds all recordings without the faults found in them: mm, N, X forward, Y up, Z right, "
    "under the model's marker names"
)


def write_corrected(folder: Path, fit: Fit, prepared: Prepared) -> tuple[str, ...]:
    """Write all recordings, corrected, into ``corrected/`` where any of them was at fault; tells of it.

    One set in one system of axes, so that it can be used in place of the given one.
    """
    effects = fit.effects
    if not any(apply.changes_markers(e.candidate) or apply.changes_forces(e.candidate) for e in effects):
        return ()
    place = folder / FOLDER
    place.mkdir()
    session = prepared.loaded.session
    static = () if session.static is None else (session.static,)
    for trial in (*static, *session.dynamic):
        write_trc(place / f"{trial.name}.trc", apply.correct_trial(trial, effects))
    for path in (*prepared.subject.calibration, *prepared.subject.evaluation):
        if path.stem in prepared.forces:
            # The forces in the session's axes, at their own rate, not filtered.
            plates = prepared.loaded.plates.get(path)
            read = read_trial_forces(path, plates, prepared.subject.forces.get(path.name))
            axes = prepared.loaded.orientation
            assert read is not None  # it was read before
            assert axes is not None
            ground = turn_forces(*read, axes)
            here = [e for e in effects if e.candidate.holds_in(path.stem)]
            corrected = apply.correct_forces(ground, ground.times, here)
            write_sto(place / f"{path.stem}_forces.mot", tabulate_forces(path.stem, corrected))
    return (_NOTE,)


def tabulate_forces(name: str, ground: GroundForces) -> Table:
    """Forces as OpenSim names them: for each plate force, point and free moment, (n, 9).

    Where a plate is not loaded the point is one of its surface.
    """
    pressed = ground.centre_of_pressure()
    point = np.where(np.isfinite(pressed), pressed, ground.surfaces)
    free = ground.moment - np.cross(point, ground.force)
    names = ["time"]
    for k in range(1, len(ground.plates) + 1):
        names += [f"ground_force_{k}_v{a}" for a in "xyz"] + [f"ground_force_{k}_p{a}" for a in "xyz"]
        names += [f"ground_torque_{k}_{a}" for a in "xyz"]
    columns = np.concatenate([ground.force, point, free], axis=2).reshape(len(ground.times), -1)
    return Table(
        name=name, columns=tuple(names), data=np.column_stack([ground.times, columns]), in_degrees=False
    )


def write_contacts(folder: Path, fit: Fit) -> tuple[str, ...]:
    """Write what a contact that no plate measured must have been, ``TRIAL_contact.sto``.

    Force on the body (N) and its moment about the origin of the ground (N m), zero outside the contact.
    Frames in which it cannot be known, such as the first and last tenths of a second, are left out.
    """
    written = []
    contacts = [e.candidate for e in fit.effects if isinstance(e.candidate.change, Contact)]
    for item in fit.wrenches:
        if item.touched is not None and any(contact.holds_in(item.name) for contact in contacts):
            table = Table(
                name=f"{item.name}_contact",
                columns=("time", *(f"contact_{component}" for component in COMPONENTS)),
                data=np.column_stack([item.times, item.touched])[item.usable],
                in_degrees=False,
            )
            write_sto(folder / f"{item.name}_contact.sto", table)
            written.append(f"{item.name}_contact.sto holds the force that was inferred")
    return tuple(written)


def save_discovery(
    results: DiscoverResults, folder: str | Path, *, report: bool = True, progress: Progress | None = None
) -> DiscoveryDocument:
    """Write ``discovery.json``, the corrected model and recordings, and the report into a folder.

    Parameters
    ----------
    results : DiscoverResults
        From :func:`discover`.
    folder : path
        Made if it does not exist. What an earlier search wrote there goes; other files stay.
    report : bool
        Whether to write ``report.html``.
    progress : callable, optional
        Called with what is being done and the share that is done, 0 to 1.

    Returns
    -------
    DiscoveryDocument
        What was written as ``discovery.json``: mm, degrees, N and N m.

    Raises
    ------
    InputError
        The folder cannot be made or written to.

    Examples
    --------
    >>> import scaling_service as ss
    >>> found = ss.discover("plates/subject.json", ss.DiscoverSettings(start="none"))
    >>> ss.save_discovery(found, "found", report=False).verdict
    'nothing'
    """
    say = progress or show_nothing
    # What an earlier search says that it wrote there
    before, place = set[Path](), Path(folder)
    with suppress(OSError, ValidationError):
        earlier = DiscoveryDocument.model_validate_json((place / FILE_NAME).read_bytes())
        inside = (place / name for name in earlier.files)
        before = {path for path in inside if path.resolve().is_relative_to(place.resolve())}
    with writing.all_or_nothing(place) as scratch:
        say("writing the model", 0.0)
        # A model for all recordings, and one for each recording that has something of its own
        fit, bones = results.lasting, results.bones
        write_model_json(scratch / "model.json", bones.add_to(models.correct_model(fit)))
        own = models.make_own_models(fit)
        for trial, model in own.items():
            write_model_json(scratch / f"{trial}_model.json", bones.add_to(model))
        notes = (
            *bones.notes,
            *(f"{trial}_model.json holds what was found in {trial} only" for trial in own),
            *models.write_corrected_osim(scratch / "model.osim", fit, results.prepared),
        )
        say("writing recordings", 0.5)
        notes += write_corrected(scratch, results.after, results.prepared)
        notes += write_contacts(scratch, results.after)
        files = sorted(p.relative_to(scratch).as_posix() for p in scratch.rglob("*") if p.is_file())
        document = results.document.model_copy(
            update={
                "files": [*files, *([writing.REPORT] if report else [])],
                "notes": list(dict.fromkeys((*results.document.notes, *notes))),
            }
        )
        writing.write_json(scratch / FILE_NAME, document)
        if report:
            say("writing the report", 0.6)
            Report(
                kind="discovery",
                name=FILE_NAME,
                summary=summarise(document),
                document=document,
                files=collect_files(lambda folder: write_discovery_scene(results, folder, INSIDE)),
                beside=document.files,
                vocabulary={"hidden_in_example": describe_hidden(document)},
            ).write(scratch)
    for path in before - {place / name for name in document.files}:
        path.unlink(missing_ok=True)
    say("done", 1.0)
    return document
