"""One door to the recordings of markers, whatever their format."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from scaling_service.core.errors import FileUnreadable
from scaling_service.files.c3d import read_c3d
from scaling_service.files.trc import read_trc
from scaling_service.model.trial import Trial

READERS: Mapping[str, Callable[[str | os.PathLike[str]], Trial]] = MappingProxyType(
    {".c3d": read_c3d, ".trc": read_trc}
)
"""Suffix (lower case) to reader. A new format is a file and a row."""


def read_recording(path: str | os.PathLike[str]) -> Trial:
    """Read a recording of markers by the suffix of its name.

    Parameters
    ----------
    path : path

    Returns
    -------
    Trial
        Positions in m in the file's own axes.

    Raises
    ------
    FileUnreadable
        If the suffix is not supported, or as the format's reader says.
    TrialUnusable
        As the format's reader says.
    """
    file = Path(path)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        said = f"'{file.suffix}' is not a format of recordings" if file.suffix else "the name has no suffix"
        raise FileUnreadable(said, file=file, remedy=f"Supported are {', '.join(READERS)}")
    return reader(file)
