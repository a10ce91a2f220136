"""The worker process: JSON requests on standard input, one a line, their JSON replies on standard output.

Started as ``python -m scaling_service.files.osim.worker``; every request names a scratch directory of its
own. Models travel as documents (see ``model.document``).
"""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
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


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Carry out a request; an error a user can act on becomes part of the answer."""
    operations: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
        "read": _read,
        "write": lambda asked: {"text": write(document.from_document(asked["model"]), asked)},
        "several": lambda asked: {"answers": [answer(each) for each in asked["requests"]]},
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


def _carry_out(asked: dict[str, Any]) -> str:
    """The reply to a request, as JSON."""
    os.chdir(asked["scratch"])
    try:
        return json.dumps({"answer": answer(asked["request"])})
    except Exception as error:  # noqa: BLE001 (whatever it is, who asked is to hear of it)
        return json.dumps({"ended": f"{type(error).__name__}: {error}"})


def _fork(asked: dict[str, Any]) -> str:
    """The same by a fork of this process."""
    theirs, ours = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            signal.setitimer(signal.ITIMER_REAL, asked["time_limit_s"])
            with os.fdopen(ours, "w", encoding="utf-8") as out:
                out.write(_carry_out(asked))
        finally:
            os._exit(0)
    os.close(ours)
    with os.fdopen(theirs, encoding="utf-8") as sent:
        reply = sent.read()
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return reply if reply and not code else json.dumps({"ended": code})


def main() -> None:
    """Answer requests until there are no more, or one where the system has no forks.

    OpenSim is kept from printing to standard output.
    """
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as replies:
        os.dup2(2, 1)
        with suppress(Exception):  # the answers say so
            library.import_opensim()
        document.make_reader()  # before there are forks, each of which would make it
        for line in sys.stdin:
            forks = hasattr(os, "fork")
            replies.write((_fork if forks else _carry_out)(json.loads(line)) + "\n")
            replies.flush()
            if not forks:
                break


if __name__ == "__main__":
    main()
