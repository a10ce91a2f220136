"""Recordings of markers, whatever their format: each file is read once, into one value."""

from __future__ import annotations

import os
from collections import abc
from dataclasses import dataclass, fields, replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType

import numpy as np

from scaling_service.core import errors
from scaling_service.model import trial as trials
from scaling_service.model.forces import PlateRecording

FORMATS = "scaling_service.formats"
"""Entry points of other distributions that read further formats: a suffix, and what reads such a file."""

READERS: abc.Mapping[str, EntryPoint] = MappingProxyType(
    {f".{entry.name.lstrip('.').lower()}": entry for entry in entry_points(group=FORMATS)}
    | {
        suffix: EntryPoint(suffix, reader, FORMATS)
        for suffix, reader in {
            ".c3d": "scaling_service.files.c3d:read_c3d",
            ".trc": "scaling_service.files.trc:read_trc",
            ".csv": "scaling_service.files.delimited:read_delimited",
            ".tsv": "scaling_service.files.delimited:read_delimited",
            ".sto": "scaling_service.files.orientations:read_orientations",
        }.items()
    }
)
"""Suffix (lower case) to what takes a path and gives a Recording; it is imported when first used."""

MOST_LABELS = 2_500
"""Chosen: ten persons with full-body sets and all that software computes from them have fewer. Trajectories
that nobody labelled do not count."""

NOT_STATED = "mm (not stated)"  # the unit of files that state none: mm is usual


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Recording(trials.Trial):
    """All that one file holds: the markers of a Trial, sizes of the person, and force plates."""

    unit: str = NOT_STATED  # Of length, as the file states it
    # Its force plates in the laboratory's axes, or why they cannot be used; None where there are none
    plates: PlateRecording | errors.TrialUnusable | None = None
    # Trajectories such as ``*110``, which nobody labelled, where the format keeps them apart
    unlabelled: trials.Trial | None = None

    @property
    def trial(self) -> trials.Trial:
        """The markers alone."""
        return trials.Trial(**{part.name: getattr(self, part.name) for part in fields(trials.Trial)})

    def with_unlabelled(self) -> trials.Trial:
        """All trajectories, also those that nobody labelled."""
        return self.trial if self.unlabelled is None else self.take_unlabelled(self.unlabelled.labels).trial

    def take_unlabelled(self, labels: abc.Collection[str]) -> Recording:
        """The recording with those of these labels among its markers that nobody gave."""
        if self.unlabelled is None:
            return self
        taken = self.unlabelled.select([label for label in self.unlabelled.labels if label in labels])
        return replace(
            self,
            labels=(*self.labels, *taken.labels),
            markers=np.concatenate([self.markers, taken.markers], axis=1),
            unlabelled=self.unlabelled.select([one for one in self.unlabelled.labels if one not in labels]),
        )


@errors.name_file
def read_recording(path: str | os.PathLike[str]) -> Recording:
    """Read a recording by the suffix of its name.

    Parameters
    ----------
    path : path
        A C3D or TRC file, a CSV or TSV table of markers, a STO table of sensors' orientations, or one in a
        format that another distribution adds.

    Returns
    -------
    Recording
        Markers (n_frames, n_markers, 3) in m, in the file's own axes, NaN where not seen; force plates and
        sizes where the file has them. ``plates`` says why plates cannot be used, which is no error.

    Raises
    ------
    FileUnreadable
        The suffix is not supported, or the file is absent or not what its suffix says.
    TrialUnusable
        The file can be read, but holds no usable trial.

    Examples
    --------
    >>> import scaling_service as ss
    >>> ss.read_recording("lab/gait_1.trc")
    Recording 'gait_1': 278 frames at 100 Hz, 14 markers
    """
    file = Path(path)
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        said = f"'{file.suffix}' is not a format of recordings" if file.suffix else "the name has no suffix"
        raise errors.FileUnreadable(said, remedy=f"Supported are {', '.join(READERS)}")
    recording: Recording = reader.load()(file)
    named = sum(not trials.is_unlabelled(label) for label in recording.labels)
    if named > MOST_LABELS:
        raise errors.TrialUnusable(
            f"it has {named:,} labels, and {MOST_LABELS:,} is the most that is looked at",
            field="labels",
            remedy="Export the markers of one person",
        )
    return recording
