"""What people see of a batch: its progress, then methods over subjects, who did not end well, the files."""

from __future__ import annotations

from collections import abc
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, Task, TaskID, TextColumn, TimeRemainingColumn
from rich.text import Text

from scaling_service.capabilities.cohort.words import make_screen_tables
from scaling_service.capabilities.shared import screen
from scaling_service.report import tables

if TYPE_CHECKING:
    from scaling_service.capabilities.cohort.outcomes import Outcome
    from scaling_service.capabilities.cohort.result import CohortDocument

_MEMORY_S = 3600.0  # chosen: the speed is judged by the last hour, for one subject may take minutes
_ROWS = 8  # chosen: subjects shown at a time; more workers than that fill a screen


def show_cohort(document: CohortDocument, out: Path, files: abc.Sequence[str]) -> None:
    """The methods over subjects, then the subjects that are not done, notes and files."""
    console = screen.make_console()
    ended = [s.status for s in document.subjects]
    counts = ", ".join(f"{ended.count(status)} {status}" for status in ("done", "skipped", "failed"))
    console.print(f"Cohort [bold]{escape(document.cohort)}[/bold]: {counts}", highlight=False, soft_wrap=True)
    if "done" in ended:
        for table in make_screen_tables(document.statistics):
            screen.print_table(console, table)
    screen.say(console, "Note", "yellow", [*document.notes, *document.statistics.notes])
    others = [tables.Row(s.id, [s.status, s.reason]) for s in document.subjects if s.status != "done"]
    if others:
        screen.print_table(
            console,
            tables.Table(caption="Not done", columns=["subject", "", "because"], rows=others, words=True),
        )
    folders = [s.folder for s in document.subjects if s.folder is not None]
    written = [f"{', '.join(folders)}  as `compare` writes them"] if folders else []
    screen.list_files(console, out, [*written, *files])


class _Rest(TimeRemainingColumn):
    """The time that is left, of the whole only: one subject's stages are too uneven to tell."""

    def render(self, task: Task) -> Text:
        return super().render(task) if task.fields["counted"] else Text("")


class Screen:
    """Shows a batch's progress on stderr; its calls may come from several threads."""

    def __init__(self, progress: Progress, *, terminal: bool) -> None:
        self._progress, self._terminal = progress, terminal
        self._lock = Lock()
        self._whole: TaskID | None = None
        self._rows: dict[str, TaskID] = {}
        self._shares: dict[str, float] = {}
        self._over: set[str] = set()
        self._kept = 0
        self.count = 0

    @property
    def ended(self) -> int:
        """How many subjects have ended."""
        return len(self._over)

    def start(self, count: int, workers: int) -> None:
        """Show the whole, all of it still to do."""
        self.count = count
        with_whom = f"{workers} at a time" if workers > 1 else "one at a time"
        self._whole = self._progress.add_task(f"{count} subjects, {with_whom}", total=count, counted="")
        self._show_whole()

    def stage(self, name: str, what: str, share: float) -> None:
        """Show where a subject is."""
        with self._lock:
            if name in self._over:  # a message that a worker sent just before it ended
                return
            self._shares[name] = share
            if name not in self._rows and len(self._rows) < _ROWS:
                self._rows[name] = self._progress.add_task("", total=1.0, counted="")
            if name in self._rows:
                said = f"  {escape(name)}: {escape(what)}"
                self._progress.update(self._rows[name], description=said, completed=share)
            self._show_whole()

    def finish(self, outcome: Outcome) -> None:
        """Count a subject, and say how it ended."""
        with self._lock:
            self._over.add(outcome.name)
            self._kept += outcome.kept
            self._shares.pop(outcome.name, None)
            row = self._rows.pop(outcome.name, None)
            if row is not None:
                self._progress.remove_task(row)
            self._show_whole()
            if not self._terminal or outcome.status == "failed":
                reason = f": {outcome.reason}" if outcome.reason else ""
                took = f" in {outcome.wall_s:.1f} s" if outcome.status == "done" and not outcome.kept else ""
                said = f"{self.ended} of {self.count}  {outcome.name} {outcome.status}{took}{reason}"
                self._progress.console.print(said, markup=False, highlight=False, soft_wrap=True)

    def _show_whole(self) -> None:
        """What was kept from an earlier run took no time, so the rest is judged by the others."""
        if self._whole is not None:
            self._progress.update(
                self._whole,
                total=self.count - self._kept,
                completed=self.ended - self._kept + sum(self._shares.values()),
                counted=f"{self.ended} of {self.count}",
            )


@contextmanager
def show_progress() -> abc.Iterator[Screen]:
    """A screen for the time of a batch; the bars are gone when it is left."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[counted]}"), _Rest())
    with Progress(
        *columns,
        console=console,
        transient=True,
        disable=not console.is_terminal,
        speed_estimate_period=_MEMORY_S,
    ) as progress:
        yield Screen(progress, terminal=console.is_terminal)
