"""Everything of one subject into memory: read, understood, questioned and prepared, stage by stage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.checks import question
from scaling_service.capabilities.subject.files import Files, read_files
from scaling_service.capabilities.subject.preparing import Loaded, prepare
from scaling_service.capabilities.subject.reading import load_subject
from scaling_service.capabilities.subject.rotations import part_rotations
from scaling_service.capabilities.subject.understanding import understand
from scaling_service.core.errors import blame_file
from scaling_service.model import subject as subjects
from scaling_service.recording.identity.identify import Identification
from scaling_service.recording.orientation import check_axes


def open_subject(
    subject: subjects.Subject | str | Path,
    settings: Settings = Settings(),
    *,
    facing: bool = False,
    rotations: bool = False,
) -> Loaded:
    """Read a subject, from its file where a path is given, and all that it names; see :func:`load`.

    ``rotations``: whether recordings of rotations without markers are wanted, apart from the others.
    Raises TrialUnusable where they are not, and there are any.
    """
    check_axes(settings.up, settings.forward)
    file = None if isinstance(subject, subjects.Subject) else Path(subject)
    known = subject if isinstance(subject, subjects.Subject) else load_subject(subject)
    with blame_file(file):
        loaded = load(known, read_files(known), settings, facing=facing)
        return replace(loaded, session=part_rotations(loaded.session, wanted=rotations), file=file)


def load(
    subject: subjects.Subject,
    files: Files,
    settings: Settings = Settings(),
    *,
    facing: bool = False,
    standing: bool = False,
    who: Identification | None = None,
) -> Loaded:
    """Understand, question and prepare what the files of a subject hold.

    Labels become the model's marker names, positions m with Y up, gaps are filled as the settings allow;
    everything that was changed is in each trial's ``repairs``. The body moves in the laboratory's own axes,
    as forces do in their files: only what is not Y up is turned, about a level axis.

    ``files``: by :func:`read_files`. ``facing``: whether to turn the person X forward, for results that are
    told along and across the way.
    ``standing``: whether motion stands as the model does, whose gravity may point along another axis than y.
    ``who``: what geometry tells of the labels, where it was asked already.
    Raises InputError: whatever a file or a label is not fit for; it names the file and the remedy.
    """
    with blame_file(None, files.recordings):
        understood = understand(subject, files, settings, facing=facing, standing=standing, who=who)
        told = question(understood, files.model)
        return prepare(understood, told, files, settings.processing)
