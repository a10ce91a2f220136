"""Errors that a user can act on: every one names the file, the field and the remedy."""

from __future__ import annotations

import functools
import os
import typing
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

P = typing.ParamSpec("P")
T = typing.TypeVar("T")
Place = typing.TypeVar("Place", bound="str | os.PathLike[str]")


class InputError(Exception):
    """Something a user gave cannot be used.

    Parameters
    ----------
    problem : str
        What is wrong, one sentence without a trailing full stop.
    file : str or Path, optional
        The file in which it was found.
    field : str, optional
        The key, column, label or component in that file.
    remedy : str, optional
        What to do about it, one sentence.

    Examples
    --------
    >>> import scaling_service as ss
    >>> try:
    ...     ss.read_model("lower_limb")
    ... except ss.InputError as error:
    ...     print(error.remedy)
    Use one of lower_limb_14dof, ..., or the path of an .osim file
    """

    def __init__(
        self,
        problem: str,
        *,
        file: str | Path | None = None,
        field: str | None = None,
        remedy: str | None = None,
    ) -> None:
        self.problem = problem
        self.file = str(file) if file is not None else None
        self.field = field
        self.remedy = remedy
        super().__init__(problem, self.file, field, remedy)

    def __str__(self) -> str:
        where = ", ".join(part for part in (self.file, self.field) if part)
        text = f"{where}: {self.problem}" if where else self.problem
        return f"{text}. {self.remedy}" if self.remedy else text

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (type(self), self.problem, self.file, self.field, self.remedy))


def _rebuild(
    kind: type[InputError], problem: str, file: str | None, field: str | None, remedy: str | None
) -> InputError:
    """Restore an error that crossed a process boundary, whatever its own constructor takes."""
    error = kind.__new__(kind)
    InputError.__init__(error, problem, file=file, field=field, remedy=remedy)
    return error


def name_file(read: Callable[typing.Concatenate[Place, P], T]) -> Callable[typing.Concatenate[Place, P], T]:
    """A reader of a file, its first argument, whose errors name that file where they name none."""

    @functools.wraps(read)
    def reading(path: Place, /, *args: P.args, **options: P.kwargs) -> T:
        try:
            return read(path, *args, **options)
        except InputError as error:
            error.file = error.file or str(path)
            raise

    return reading


class FileUnreadable(InputError):
    """A file is absent, empty, truncated or not what its name says."""


class SubjectInvalid(InputError):
    """The subject document does not follow its contract."""


class ModelRefused(InputError):
    """A body model holds a component that cannot be represented; it is named in ``field``."""


class TrialUnusable(InputError):
    """A recording was read but cannot be used for what was asked."""


class MarkerMissing(InputError):
    """A marker that is needed has no label in a recording."""

    def __init__(self, marker: str, trial: str, present: Sequence[str]) -> None:
        shown = ", ".join(present[:12]) + (", …" if len(present) > 12 else "")
        super().__init__(
            f"trial '{trial}' has no marker '{marker}'; it has {shown}",
            field=f"markers.{marker}",
            remedy=f"Map the label that means '{marker}' under `markers:` in the subject file; if none does, "
            "record it",
        )
        self.marker = marker
        self.trial = trial


class DependencyMissing(InputError):
    """An optional library is needed for what was asked."""


@contextmanager
def blame_file(file: Path | None, trials: Iterable[Path] = ()) -> Iterator[None]:
    """Let errors raised inside name a file.

    ``file``: named where an error names none. ``trials``: named where an error names the bare stem of one.
    """
    try:
        yield
    except InputError as error:
        by_stem = {path.stem: path for path in trials}
        found = file if error.file is None else by_stem.get(error.file)
        if found is not None:
            error.file = str(found)
        raise
