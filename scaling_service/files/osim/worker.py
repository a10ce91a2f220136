"""The worker process: one JSON request on standard input, one JSON answer on standard output.

Started as ``python -m scaling_service.files.osim.worker`` in a scratch directory of its own.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

from scaling_service.core.errors import InputError
from scaling_service.files.osim.worker_read import read
from scaling_service.files.osim.worker_write import amend, build

OPERATIONS: Mapping[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "read": read,
    "amend": amend,
    "build": build,
}


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Carry out a request; an error a user can act on becomes part of the answer."""
    try:
        return OPERATIONS[request["operation"]](request)
    except InputError as error:
        return {
            "error": {
                "kind": type(error).__name__,
                "problem": error.problem,
                "file": error.file,
                "field": error.field,
                "remedy": error.remedy,
            }
        }


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
