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

from scaling_service.core.errors import DependencyMissing, InputError
from scaling_service.formats.osim import write_osim
from scaling_service.jobs.documents import comparison_document, method_document, scaling_document
from scaling_service.jobs.motions import write_motion
from scaling_service.jobs.tasks import Progress, Results, Scaling
from scaling_service.models.document import to_document
from scaling_service.schemas.results import ComparisonDocument, MethodResult, TruthDocument


def save(
    results: Results,
    folder: str | Path,
    *,
    comparison: bool = True,
    truth: TruthDocument | None = None,
    progress: Progress | None = None,
) -> ComparisonDocument:
    """Write results into a folder.

    Every method gets a folder of its name with ``model.osim``, ``model.json``, ``<trial>_ik.mot`` and
    ``scaling.json``; ``comparison.json`` stands beside them. All is written elsewhere first, so that a
    failure leaves the folder as it was. Other files in it stay.

    Parameters
    ----------
    folder : path
        Made if it does not exist.
    comparison : bool
        Whether to write ``comparison.json``.
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
    with _all_or_nothing(Path(folder)) as scratch:
        written: dict[str, MethodResult] = {}
        for k, (method, scaling) in enumerate(results.scalings.items()):
            if progress is not None:
                progress(f"{method}: writing", k / len(results.scalings))
            written[method] = _write_method(scratch / method, scaling, results)
        document = comparison_document(results, written, truth)
        if comparison:
            write_json(scratch / "comparison.json", document)
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
    try:
        _write_osim(folder / "model.osim", scaling, results)
    except DependencyMissing as error:
        warnings.append(f"model.osim was not written: {error}")
    files = sorted(path.name for path in folder.iterdir())
    document = method_document(scaling, results, files, warnings)
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
    if place.exists() and not place.is_dir():
        raise InputError("it is a file", file=place, field="--out", remedy="Name a folder")
    if not os.access(_existing(place), os.W_OK | os.X_OK):
        raise _unwritable(place, "no permission")


def _existing(folder: Path) -> Path:
    """The folder, or the nearest one above that exists."""
    return next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())


@contextmanager
def _all_or_nothing(folder: Path) -> Iterator[Path]:
    """A scratch folder on the target's disk, whose content moves to the target at the end."""
    beside = _existing(folder.absolute().parent)
    try:
        scratch = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=beside))
    except OSError as error:
        raise _unwritable(folder, error.strerror) from None
    try:
        yield scratch
        try:
            _moved_into(scratch, folder)
        except OSError as error:
            raise _unwritable(folder, error.strerror) from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _moved_into(scratch: Path, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for source in sorted(scratch.rglob("*")):
        target = folder / source.relative_to(scratch)
        if source.is_dir():
            target.mkdir(exist_ok=True)
            # Motions of an earlier run belong to a model that is no longer there.
            for old in target.glob("*_ik.mot"):
                old.unlink()
        else:
            source.replace(target)


def _unwritable(folder: Path, reason: str | None) -> InputError:
    return InputError(
        f"results cannot be written there: {reason}",
        file=folder,
        field="--out",
        remedy="Name a folder that can be made and written to",
    )
