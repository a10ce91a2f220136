"""A look at a folder's files onto disk, with a subject file to correct and to scale by."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from scaling_service.capabilities.intake.document import ProofDocument
from scaling_service.capabilities.intake.run import Progress, prove
from scaling_service.capabilities.subject.settings import Settings
from scaling_service.core.errors import FileUnreadable
from scaling_service.documents.subject import MODEL_SUFFIXES
from scaling_service.documents.writing import all_or_nothing, write_json

FILE_NAME, SUBJECT = "proof.json", "subject.yaml"

_FILES = ("marker_set", "scale_setup", "image_markers")


def prove_folder(
    folder: str | Path, out: str | Path, settings: Settings = Settings(), *, progress: Progress | None = None
) -> ProofDocument:
    """Look at all files of a folder, and write what was found into another one.

    ``proof.json`` is the document, ``proof/`` holds the tables that it names, and ``subject.yaml`` is the
    subject file that is proposed, where there is a recording.

    Parameters
    ----------
    folder, out : path
        ``out`` is made if it does not exist; other files in it stay.
    settings : Settings
        The laboratory's axes, where they are known.
    progress : callable, optional

    Raises
    ------
    FileUnreadable
        There is no such folder.
    InputError
        The axes are none, or ``out`` cannot be written to.
    """
    source, target = Path(folder), Path(out)
    if not source.is_dir():
        raise FileUnreadable(
            "there is no such folder", file=source, remedy="Name the folder of the recordings"
        )
    name = source.absolute().name
    identity = name if re.fullmatch(r"\w[\w .\-]{0,99}", name) else "subject"
    with all_or_nothing(target) as scratch:
        found = prove(source, {"subject": {"id": identity}}, scratch, settings=settings, progress=progress)
        write_json(scratch / FILE_NAME, found)
        if found.proposal is not None:
            beside = os.path.relpath(source.absolute(), target.absolute())
            content = _elsewhere(found.proposal, Path(beside))
            (scratch / SUBJECT).write_text(
                yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8"
            )
    return found


def _elsewhere(document: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The document with the paths of files that lie in another folder."""

    def at(name: str) -> str:
        return (folder / name).as_posix()

    content = dict(document)
    if str(content["model"]).lower().endswith(MODEL_SUFFIXES):
        content["model"] = at(content["model"])
    content |= {key: at(content[key]) for key in _FILES if key in content}
    content["trials"] = {
        role: at(files) if isinstance(files, str) else [at(name) for name in files]
        for role, files in document["trials"].items()
    }
    for part in ("forces", "bones"):
        if part in content:
            content[part] = {k: v if k == "units" else at(v) for k, v in content[part].items()}
    return content
