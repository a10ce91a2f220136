"""The worker process: one JSON request on standard input, one JSON answer on standard output.

Started as ``python -m scaling_service.files.osim.worker`` in a scratch directory of its own. Models travel as
documents (see ``model.document``).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from scaling_service.core.errors import InputError
from scaling_service.files.osim import library, muscle_paths, tools
from scaling_service.files.osim.from_opensim import read_body_model
from scaling_service.files.osim.musculature import describe
from scaling_service.files.osim.to_opensim import write
from scaling_service.model import document


def _read(request: dict[str, Any]) -> dict[str, Any]:
    path = Path(request["file"])
    model = read_body_model(library.load(path, request["marker_set"]))
    unknown = library.list_unknown(path)
    if unknown:
        names = ", ".join(f"{name} ({kind})" for name, kind in unknown)
        said = f"passed by, for OpenSim does not know them and motion does not need them: {names}"
        model = replace(model, notes=(*model.notes, said))
    return {"model": document.to_document(model)}


def _write(request: dict[str, Any]) -> dict[str, Any]:
    return {"text": write(document.from_document(request["model"]), request)}


def _answer_several(request: dict[str, Any]) -> dict[str, Any]:
    return {"answers": [answer(each) for each in request["requests"]]}


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Carry out a request; an error a user can act on becomes part of the answer."""
    operations: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
        "read": _read,
        "write": _write,
        "several": _answer_several,
        "muscles": muscle_paths.measure,
        "musculature": describe,
        "attachments": muscle_paths.list_points,
        "move attachments": muscle_paths.move_points,
        "muscle parameters": muscle_paths.set_lengths,
        "scale": tools.scale,
        "track": tools.track,
        "trace": tools.trace,
    }
    try:
        return operations[request["operation"]](request)
    except InputError as error:
        described = {name: getattr(error, name) for name in ("problem", "file", "field", "remedy")}
        return {"error": {"kind": type(error).__name__, **described}}


def main() -> None:
    """Read the request, keep OpenSim's own printing off standard output, write the answer."""
    request = json.loads(sys.stdin.read())
    reply = os.dup(1)
    os.dup2(2, 1)
    text = json.dumps(answer(request))
    with os.fdopen(reply, "w", encoding="utf-8") as out:
        out.write(text)


if __name__ == "__main__":
    main()
