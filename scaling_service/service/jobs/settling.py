"""What becomes of a job when its attempt ended."""

from __future__ import annotations

import json
import logging
import time
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, field

from scaling_service.documents.jobs import Failure, State
from scaling_service.service.jobs.attempts import AttemptFolder
from scaling_service.service.jobs.identity import code_version
from scaling_service.service.jobs.ledger import Ledger, Made, lost_too_often
from scaling_service.service.jobs.machine import Event
from scaling_service.service.jobs.outcomes import Failed, Finished, Hindered, Lost, Outcome, Stopped
from scaling_service.service.jobs.provenance import provenance
from scaling_service.service.store.blobs import Content
from scaling_service.service.store.errors import ContentMissing
from scaling_service.service.store.rows import JobRow

log = logging.getLogger(__name__)


@dataclass(slots=True)
class Held:
    """An attempt that a runner looks after.

    Parameters
    ----------
    row : JobRow
        As leased.
    specification : str
    folder : AttemptFolder
    future : Future
        Of the outcome.
    """

    row: JobRow
    specification: str
    folder: AttemptFolder
    future: Future[Outcome]
    begun: float = field(default_factory=time.monotonic)


def settle(ledger: Ledger, held: Held) -> State | None:
    """Record how an attempt ended, and remove its folder.

    Returns
    -------
    State or None
        Where the job stands now; None where this attempt no longer holds it, and nothing was kept.

    Raises
    ------
    StoreUnavailable
        Nothing was recorded; call it again later.
    """
    outcome = outcome_of(held.future)
    wall_s = time.monotonic() - held.begun
    host = outcome.host if isinstance(outcome, Finished) else held.row.host
    origin = provenance(held.row, held.specification, code_version(), host, wall_s)
    try:
        state = _record(ledger, held, outcome, origin)
    except ContentMissing as error:  # somebody else removed what was made
        outcome = Lost(error.problem)
        state = _record(ledger, held, outcome, origin)
    _note(held.row, outcome, state, wall_s)
    held.folder.remove()
    return state


def _record(ledger: Ledger, held: Held, outcome: Outcome, origin: str) -> State | None:
    if isinstance(outcome, Finished):
        return ledger.finish(held.row, _made(outcome, held.folder), origin)
    return ledger.settle(held.row, *_event(outcome, held.row), origin)


def outcome_of(future: Future[Outcome]) -> Outcome:
    """How an attempt ended, also where the executor itself broke."""
    try:
        return future.result()
    except CancelledError:
        return Stopped()
    except Exception as error:  # noqa: BLE001 (an executor raises what it likes when a worker is gone)
        return Lost(f"the executor failed ({type(error).__name__})")


def _event(outcome: Failed | Lost | Hindered | Stopped, row: JobRow) -> tuple[Event, Failure]:
    match outcome:
        case Failed():
            return Event.FAIL, outcome.failure
        case Stopped():
            return Event.RELEASE, lost_too_often(row, "it was stopped")
        case _:
            return Event.LOSE, lost_too_often(row, outcome.reason)


def _made(outcome: Finished, folder: AttemptFolder) -> Made:
    outputs = folder.folder / "outputs"
    return Made(
        json.dumps(outcome.result, allow_nan=False),
        tuple((path, Content(sha256, size, outputs / path)) for path, sha256, size in outcome.files),
    )


def _note(row: JobRow, outcome: Outcome, state: State | None, wall_s: float) -> None:
    """One line for the log, without anything of the patient's."""
    told = {
        "job": row.id,
        "kind": row.kind,
        "attempt": row.attempt,
        "outcome": type(outcome).__name__,
        "state": None if state is None else state.value,
        "wall_s": round(wall_s, 3),
    }
    if isinstance(outcome, Failed):
        told |= {"failure": outcome.failure.kind, "trace": outcome.trace}
    if isinstance(outcome, Lost | Hindered):
        told["reason"] = outcome.reason
    usual = isinstance(outcome, Finished | Stopped) or (isinstance(outcome, Failed) and not outcome.trace)
    log.log(logging.INFO if usual else logging.WARNING, "attempt ended", extra=told)
