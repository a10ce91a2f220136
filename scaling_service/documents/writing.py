"""Results onto disk: complete, or nothing at all; and which program wrote them."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections import abc
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pydantic import BaseModel

from scaling_service.core.errors import InputError

REPORT = "report.html"
CYCLES_TABLE = "clinical_angles.csv"
SKELETON = "bones.glb"
BONES = "bones"
"""The folder of single bones."""

OF_A_MODEL = ("*_ik.mot", "*_clinical.csv", CYCLES_TABLE, SKELETON, f"{BONES}/*.stl")
"""Files in a method's folder that say nothing without its model."""


def code_version() -> str:
    """The installed package's version."""
    try:
        return version("scaling-service")
    except PackageNotFoundError:
        return "not installed"


def write_json(path: Path, document: BaseModel, *, without: abc.Collection[str] = ()) -> None:
    """A document, some of its fields left out, as JSON for people and programs."""
    content = document.model_dump(mode="json", exclude=set(without))
    path.write_text(
        json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
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
        nearest = _find_existing(place)
        if not nearest.is_dir():
            said = "it is a file" if nearest == place.absolute() else f"'{nearest}' is a file"
            raise InputError(said, file=place, field="--out", remedy="Name a folder")
        writable = os.access(nearest, os.W_OK | os.X_OK)
    except OSError as error:  # a name that is too long
        raise _explain_unwritable(place, error.strerror) from None
    if not writable:
        raise _explain_unwritable(place, "no permission")


def _find_existing(folder: Path) -> Path:
    """The folder, or the nearest one above that exists."""
    return next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())


@contextmanager
def all_or_nothing(folder: Path) -> abc.Iterator[Path]:
    """A scratch folder on the target's disk, whose content moves to the target at the end."""
    check_folder(folder)
    try:
        # Within the folder where it is there: what is above it may be another disk, or not ours to write to.
        scratch = Path(tempfile.mkdtemp(prefix=".scaling-service-", dir=_find_existing(folder)))
    except OSError as error:
        raise _explain_unwritable(folder, error.strerror) from None
    try:
        new = scratch / "new"
        new.mkdir()
        yield new
        try:
            _exchange(new, folder.absolute(), scratch / "old")
        except OSError as error:
            raise _explain_unwritable(folder, error.strerror) from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _exchange(new: Path, folder: Path, old: Path) -> None:
    """Move files into the folder and what they replace out of it; nothing if it fails or is interrupted."""
    sources = [path for path in sorted(new.rglob("*")) if not path.is_dir()]
    targets = [folder / source.relative_to(new) for source in sources]
    # A folder may stand in a file's place, or a file in the place of a method's folder.
    blocked = [(target.parent, "file") for target in targets if target.parent.is_file()]
    blocked += [(target, "folder") for target in targets if target.is_dir()]
    for place, kind in blocked:
        raise InputError(
            f"'{place.relative_to(folder)}' is a {kind} there, in the way of a result",
            file=folder,
            field="--out",
            remedy="Move it away, or name another folder",
        )
    # Motions and bones of an earlier run belong to a model that is no longer there, a report to its numbers.
    places = sorted({target.parent for target in targets} - {folder})
    stale = [path for place in places for pattern in OF_A_MODEL for path in sorted(place.glob(pattern))]
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


def _explain_unwritable(folder: Path, reason: str | None) -> InputError:
    return InputError(
        f"results cannot be written there: {reason}",
        file=folder,
        field="--out",
        remedy="Name a folder that can be made and written to",
    )
