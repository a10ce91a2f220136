"""The name of a job: one SHA-256 over all that its result depends on, and its owner."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

from scaling_service.documents.writing import code_version as released_version

_SUFFIXES = (".py", ".yaml", ".json", ".csv")
"""Files of the package that results can depend on."""

_PAGE = "service/page/"
"""The web page's sources and bundle: no result depends on them."""


def canonical(document: Any) -> str:
    """JSON in the one form that equal documents share: sorted keys, no spaces, no NaN.

    Raises
    ------
    ValueError
        A number is not finite, or a text holds half a character.

    Examples
    --------
    >>> canonical({"b": 1.0, "a": ["µ", None]})
    '{"a":["µ",null],"b":1.0}'
    """
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    text.encode()  # UnicodeEncodeError, which is a ValueError
    return text


def specification(
    kind: str,
    request: Mapping[str, Any],
    documents: Mapping[str, Any],
    inputs: Mapping[str, str],
    code: str,
    owner: str,
) -> str:
    """The canonical JSON of a job.

    Parameters
    ----------
    kind : str
    request : mapping
        JSON-ready, with every default written out.
    documents : mapping
        Subject to its document.
    inputs : mapping
        Path to SHA-256 of each input.
    code : str
        See :func:`code_version`.
    owner : str
        Part of the name, so that no owner can ask whether another has the same data.
    """
    return canonical(
        {
            "kind": kind,
            "request": request,
            "documents": documents,
            "inputs": inputs,
            "code_version": code,
            "owner": owner,
        }
    )


def job_id(text: str) -> str:
    """The SHA-256 of a specification, in hexadecimal.

    Examples
    --------
    >>> job_id("{}")[:8]
    '44136fa3'
    """
    return hashlib.sha256(text.encode()).hexdigest()


@cache
def code_version() -> str:
    """The released version, and the first digits of the SHA-256 of the package's files.

    The files are read once in a process, so that it tells what the process started with.
    """
    digest = hashlib.sha256()
    for name, file in sorted(_files(files("scaling_service"), "")):
        content = file.read_bytes()
        digest.update(f"{len(name)}:{name}:{len(content)}:".encode() + content)
    return f"{released_version()}+{digest.hexdigest()[:12]}"


def _files(folder: Traversable, path: str) -> list[tuple[str, Traversable]]:
    found: list[tuple[str, Traversable]] = []
    for entry in folder.iterdir():
        name = f"{path}{entry.name}"
        if entry.is_dir():
            apart = entry.name.startswith(("__", ".")) or f"{name}/" == _PAGE
            found += [] if apart else _files(entry, f"{name}/")
        elif name.endswith(_SUFFIXES):
            found.append((name, entry))
    return found
