"""Results onto disk: complete, or nothing at all."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel

from scaling_service.capabilities.motion.motion_files import write_motion
from scaling_service.capabilities.scaling.bone_files import FOLDER as BONES
from scaling_service.capabilities.scaling.bone_files import SKELETON, write_bones
from scaling_service.capabilities.scaling.clinical.document import CYCLES_TABLE, clinical_of, write_clinical
from scaling_service.capabilities.scaling.documents import (
    comparison_document,
    method_document,
    scaling_document,
)
from scaling_service.capabilities.scaling.judging import verdict_document, verdict_of
from scaling_service.capabilities.scaling.reporting import REPORT, report_html
from scaling_service.capabilities.scaling.run import Progress, Results, Scaling
from scaling_service.core.errors import DependencyMissing, InputError
from scaling_service.documents.results import ComparisonDocument, MethodResult, TruthDocument
from scaling_service.files.osim import write_osim
from scaling_service.model.document import to_document


def save(
    results: Results,
    folder: str | Path,
    *,
    comparison: bool = True,
    report: bool = True,
    truth: TruthDocument | None = None,
    progress: Progress | None = None,
) -> ComparisonDocument:
    """Write results into a folder.

    Every method gets a folder of its name with ``model.osim``, ``model.json``, ``<trial>_ik.mot``,
    ``<trial>_clinical.csv`` and ``scaling.json``, ``clinical_angles.csv`` where there are gait cycles, and
    its bones where it is made from images; ``comparison.json`` and ``report.html`` stand beside them. All is
    written elsewhere first, so that a failure leaves the folder as it was. Other files in it stay.

    Parameters
    ----------
    folder : path
        Made if it does not exist.
    comparison : bool
        Whether to write ``comparison.json`` and, with it, the report.
    report : bool
        Whether to write ``report.html``.
    truth : TruthDocument, optional
        Of a virtual subject.
    progress : callable, optional

    Returns
    -------
    ComparisonDocument
        What was, or would have been, written as ``comparison.json``.

    Raises
    ------
    InputError
        The folder cannot be made or written to.
    """
    with all_or_nothing(Path(folder)) as scratch:
        written: dict[str, MethodResult] = {}
        for k, (method, scaling) in enumerate(results.scalings.items()):
            if progress is not None:
                progress(f"{method}: writing", k / len(results.scalings))
            written[method] = _write_method(scratch / method, scaling, results)
        verdict = verdict_of(results)
        document = comparison_document(results, written, truth, verdict_document(verdict))
        if comparison:
            write_json(scratch / "comparison.json", document)
        if comparison and report:
            if progress is not None:
                progress("writing the report", 1.0)
            (scratch / REPORT).write_text(report_html(results, document, verdict), encoding="utf-8")
    return document


def write_json(path: Path, document: BaseModel) -> None:
    """A document as JSON for people and programs."""
    content = document.model_dump(mode="json")
    path.write_text(
        json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )


def _write_method(folder: Path, scaling: Scaling, results: Results) -> MethodResult:
    folder.mkdir()
    calibration, warnings = scaling.calibration, list[str]()
    content = json.dumps(to_document(calibration.model), indent=1, allow_nan=False)
    (folder / "model.json").write_text(content + "\n", encoding="utf-8")
    for name, motion in scaling.motions.items():
        write_motion(folder / f"{name}_ik.mot", motion, calibration.model)
    gait = clinical_of(scaling, results)
    write_clinical(folder, gait)
    try:
        _write_osim(folder / "model.osim", scaling, results)
    except DependencyMissing as error:
        warnings.append(f"model.osim was not written: {error}")
    if results.session.images is not None:
        write_bones(folder, calibration, results.session.images.bones)
    files = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    document = method_document(scaling, results, files, warnings, gait)
    write_json(folder / "scaling.json", scaling_document(results, document))
    return document


def _write_osim(path: Path, scaling: Scaling, results: Results) -> None:
    calibration, subject = scaling.calibration, results.session.subject
    if not subject.model.lower().endswith(".osim"):
        write_osim(path, calibration.model)
        return
    setup = results.session.scale_setup
    write_osim(
        path,
        calibration.model,
        source=Path(subject.model),
        factors=calibration.scale_factors,
        axis_tilts=calibration.axis_tilts,
        marker_set=subject.marker_set,
        preserve_mass_distribution=setup is None or setup.preserve_mass_distribution,
        inertia_from_model=True,
    )


def check_folder(folder: str | Path) -> None:
    """Whether results can be written there, asked before anything long is computed.

    Raises
    ------
    InputError
        It is a file, or cannot be made or written to.
    """
    place = Path(folder)
    try:
        nearest = _existing(place)
        if not nearest.is_dir():
            said = "it is a file" if nearest == place.absolute() else f"'{nearest}' is a file"
            raise InputError(said, file=place, field="--out", remedy="Name a folder")
        writable = os.access(nearest, os.W_OK | os.X_OK)
    except OSError as error:  # a name that is too long
        raise _unwritable(place, error.strerror) from None
    if not writable:
        raise _unwritable(place, "no permission")


def _existing(folder: Path) -> Path:
    """The folder, or the nearest one above that exists."""
    return next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())


@contextmanager
def all_or_nothing(folder: Path) -> Iterator[Path]:
    """A scratch folder on the target's disk, whose content moves to the target at the end."""
    check_folder(folder)
    try:
        # Within the folder where it is there: what is above it may be another disk, or not ours to write to.
        scratch = Path(tempfile.mkdtemp(prefix=".scaling-service-", dir=_existing(folder)))
    except OSError as error:
        raise _unwritable(folder, error.strerror) from None
    try:
        new = scratch / "new"
        new.mkdir()
        yield new
        try:
            _exchange(new, folder.absolute(), scratch / "old")
        except OSError as error:
            raise _unwritable(folder, error.strerror) from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _exchange(new: Path, folder: Path, old: Path) -> None:
    """Move files into the folder and what they replace out of it; nothing if it fails or is interrupted."""
    sources = [path for path in sorted(new.rglob("*")) if not path.is_dir()]
    targets = [folder / source.relative_to(new) for source in sources]
    for target in targets:
        _refuse_in_the_way(target, folder)
    # Motions and bones of an earlier run belong to a model that is no longer there, a report to its numbers.
    stale = [p for place in sorted({t.parent for t in targets} - {folder}) for p in _of_a_model(place)]
    if folder / "comparison.json" in targets:
        stale += [path for path in (folder / REPORT,) if path.is_file()]
    replaced = list(dict.fromkeys([*stale, *(target for target in targets if target.exists())]))
    moves = [(path, old / path.relative_to(folder)) for path in replaced]
    moves += list(zip(sources, targets, strict=True))
    made: list[Path] = []
    begun: list[tuple[Path, Path]] = []
    try:
        for source, target in moves:
            for place in reversed([p for p in (target.parent, *target.parent.parents) if not p.exists()]):
                made.append(place)
                place.mkdir()
            begun.append((source, target))
            source.replace(target)
    except BaseException:
        for source, target in reversed(begun):
            if not source.exists():
                target.replace(source)
        for place in reversed(made):
            if place.is_dir():
                place.rmdir()
        raise


def _of_a_model(place: Path) -> list[Path]:
    return [
        path
        for pattern in ("*_ik.mot", "*_clinical.csv", CYCLES_TABLE, SKELETON, f"{BONES}/*.stl")
        for path in sorted(place.glob(pattern))
    ]


def _refuse_in_the_way(target: Path, folder: Path) -> None:
    """Raise where a folder stands in a file's place, or a file in the place of a method's folder."""
    for place, kind, wrong in (
        (target.parent, "file", target.parent.is_file()),
        (target, "folder", target.is_dir()),
    ):
        if wrong:
            raise InputError(
                f"'{place.relative_to(folder)}' is a {kind} there, in the way of a result",
                file=folder,
                field="--out",
                remedy="Move it away, or name another folder",
            )


def _unwritable(folder: Path, reason: str | None) -> InputError:
    return InputError(
        f"results cannot be written there: {reason}",
        file=folder,
        field="--out",
        remedy="Name a folder that can be made and written to",
    )
