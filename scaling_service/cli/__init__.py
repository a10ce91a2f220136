"""The command line: what people type, what they see, and nothing that computes."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from scaling_service.core.text import name_version
from scaling_service.core.threads import use_one_thread

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str, optional
        Those of the process unless given.

    Returns
    -------
    int
        0, or 1 if some subjects of a batch failed, or 2 if something that was given cannot be used, or 130
        if interrupted. Anything else that goes wrong is a defect of the program and leaves as an exception.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given == ["--version"]:  # answered before anything is loaded
        print(name_version())  # noqa: T201 (the command line's own output)
        return 0
    use_one_thread()  # before anything imports numpy
    from scaling_service.cli.app import run

    return run(given)
