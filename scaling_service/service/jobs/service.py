"""What the outside asks for, whether over HTTP or not: subjects, files, jobs, keys. Nothing here computes.

Every function takes the owner first and sees that owner's things only: what is not there for the owner is
NotFound. All are thread-safe and return within milliseconds, but for uploads and deletions.
"""

from __future__ import annotations

import json
from collections import abc
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection

from scaling_service.capabilities.shared.job import JobRequest
from scaling_service.documents.base import require_plain_name
from scaling_service.documents.jobs import State
from scaling_service.service.jobs import submission
from scaling_service.service.jobs.kinds import KINDS, Kind
from scaling_service.service.jobs.ledger import Ledger
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store import deletion, jobs, links, subjects, tables
from scaling_service.service.store.blobs import Incoming
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.room import Quotas
from scaling_service.service.store.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """A file on its way: write chunks, then keep it. Left without that, it leaves no trace."""

    service: Service
    owner: str
    subject: str
    name: str
    incoming: Incoming

    def write(self, chunk: bytes) -> None:
        """Add bytes; TooLarge where more came than is allowed, StoreFull where the disk is nearly full."""
        self.service.require_room(len(chunk))
        self.incoming.write(chunk)

    def keep(self) -> tables.FileRow:
        """All has come; the file is the subject's, in place of one of the same name."""
        store, most = self.service.store, self.service.settings.limit_files
        content = self.incoming.finish()
        place = (self.owner, self.subject, self.name)
        self.service.quotas.require(self.owner, content.size)
        row = subjects.attach(store.database, store.blobs, *place, content, most=most)
        self.service.quotas.add(self.owner, content.size)
        return row


class Service:
    """All that can be asked of a service."""

    def __init__(
        self, store: Store, settings: ServiceSettings, kinds: abc.Mapping[str, Kind] = KINDS
    ) -> None:
        self.store, self.settings, self.kinds = store, settings, kinds
        self._database = store.database
        self._ledger = Ledger(store, settings.most_losses, settings.lease_s)
        self.quotas = Quotas(store.database, settings.limit_owner_mb * 1_000_000)

    @classmethod
    def open(cls, settings: ServiceSettings) -> Service:
        """The service on the data directory and database of the settings."""
        return cls(open_store(settings), settings)

    # Subjects

    def put_subject(self, owner: str, document: abc.Mapping[str, Any]) -> tuple[tables.SubjectRow, bool]:
        """Keep a subject's document under the name that it gives; whether that name is new."""
        name = submission.check_subject(document)
        self.require_room()
        text, most = submission.write_canonical_subject(document), self.settings.limit_subjects
        return subjects.put(self._database, owner, name, text, most=most)

    def subject(self, owner: str, subject: str) -> tables.SubjectRow:
        """One subject."""
        return subjects.get(self._database, owner, _require_known_name(subject, "subject"))

    def subject_document(self, owner: str, subject: str) -> dict[str, Any]:
        """A subject's document."""
        with self.store.read() as connection:
            text = subjects.read_document(connection, owner, _require_known_name(subject, "subject"))
        document: dict[str, Any] = json.loads(text)
        return document

    def subjects(
        self, owner: str, cursor: str | None = None, limit: int = 50
    ) -> tables.Page[tables.SubjectRow]:
        """An owner's subjects, newest first."""
        return subjects.list_page(self._database, owner, cursor, limit)

    def delete_subject(self, owner: str, subject: str) -> None:
        """Delete a subject, its files, and all jobs on them, for good."""
        with self._deleting(owner):
            deletion.delete_subject(
                self._database, self.store.blobs, owner, _require_known_name(subject, "subject")
            )

    def note(self, owner: str, subject: str) -> tables.WrittenRow | None:
        """What was written about a subject's results; None where nothing was."""
        return subjects.read_note(self._database, owner, self.subject(owner, subject).id)

    def put_note(self, owner: str, subject: str, document: abc.Mapping[str, Any]) -> tables.WrittenRow | None:
        """Keep what is written about a subject's results, in place of what was."""
        self.require_room()
        text = submission.write_canonical(dict(document))
        subjects.put_note(self._database, owner, _require_known_name(subject, "subject"), text)
        return self.note(owner, subject)

    # Files of subjects

    @contextmanager
    def upload(self, owner: str, subject: str, name: str) -> abc.Iterator[Upload]:
        """Take a file for a subject: ``upload.write(chunk)``, and at last ``upload.keep()``."""
        require_plain_name(name)
        self.subject(owner, subject)
        self.require_room()
        self.quotas.require(owner)
        with self.store.incoming(self.settings.limit_upload_mb * 1_000_000) as incoming:
            yield Upload(service=self, owner=owner, subject=subject, name=name, incoming=incoming)

    def subject_files(self, owner: str, subject: str) -> list[tables.FileRow]:
        """A subject's files, by name."""
        return subjects.list_files(self._database, owner, _require_known_name(subject, "subject"))

    def subject_file(self, owner: str, subject: str, name: str) -> tuple[tables.FileRow, Path]:
        """One file of a subject and where its content lies."""
        return self._one(self.subject_files(owner, subject), name)

    def remove_subject_file(self, owner: str, subject: str, name: str) -> None:
        """Remove a file of a subject; jobs that were asked for before keep theirs."""
        self.subject_file(owner, subject, name)
        with self._deleting(owner):
            subjects.detach(self._database, self.store.blobs, owner, subject, name)

    # The laboratory

    def marker_map(self, owner: str) -> tables.WrittenRow | None:
        """Which label is which marker in an owner's laboratory; None where that was never said."""
        return subjects.read_marker_map(self._database, owner)

    def put_marker_map(self, owner: str, labels: abc.Mapping[str, str]) -> tables.WrittenRow | None:
        """Keep which label is which marker, in place of what was said before."""
        self.require_room()
        subjects.put_marker_map(self._database, owner, submission.write_canonical(dict(labels)))
        return self.marker_map(owner)

    # Links

    def make_link(self, owner: str, path: str, lifetime_s: int) -> tuple[str, int]:
        """A ticket that opens a path on the owner's behalf, and its end, µs since 1970."""
        return links.issue(self._database, owner, path, lifetime_s)

    def end_links(self, owner: str) -> None:
        """Let none of an owner's links open anything any more."""
        links.end_all(self._database, owner)

    # Jobs

    def ask(
        self, owner: str, kind: str, request: abc.Mapping[str, Any] | JobRequest
    ) -> tuple[tables.JobRow, bool]:
        """Ask for a job, or find the one that was asked for before; whether this put it in the queue.

        RequestInvalid or SubjectInvalid where what is asked for cannot be done; QueueFull where too many
        jobs of this owner are waiting, QuotaReached where their files take too much room.
        """
        row = self.kinds.get(kind)
        if row is None or row.route is None:
            raise NotFound(f"there is no kind of job '{kind}'", field="kind")
        checked, made_of = submission.check_request(row, request), row.parts

        def make(connection: Connection) -> jobs.NewJob:
            new = submission.make_new_job(connection, owner, kind, checked, made_of)
            if jobs.find(connection, new.id) is None:
                self.quotas.require(owner)
            return new

        return self._ledger.ask(make, self.settings.limit_queue)

    def job(self, owner: str, job: str) -> tables.JobRow:
        """One job; ``revision`` grows with any change."""
        return jobs.get(self._database, owner, _require_known_name(job, "job"))

    def jobs(
        self,
        owner: str,
        *,
        state: State | None = None,
        kind: str | None = None,
        subject: str | None = None,
        cursor: str | None = None,
        limit: int = 50,
    ) -> tables.Page[tables.JobRow]:
        """An owner's jobs, newest first."""
        for what, name in (("kind", kind), ("subject", subject)):
            _require_known_name(name or "", what)
        return jobs.list_page(
            self._database, owner, state=state, kind=kind, subject=subject, cursor=cursor, limit=limit
        )

    def specification(self, owner: str, job: str) -> str:
        """What was asked for, as canonical JSON; its SHA-256 is the job's name."""
        return jobs.read_documents(self._database, owner, _require_known_name(job, "job"))[0]

    def result(self, owner: str, job: str) -> str | None:
        """The result as JSON; None where there is none (yet)."""
        return jobs.read_documents(self._database, owner, _require_known_name(job, "job"))[1]

    def provenance(self, owner: str, job: str) -> str | None:
        """Where the result came from, as JSON; None where there is none (yet)."""
        return jobs.read_documents(self._database, owner, _require_known_name(job, "job"))[2]

    def files(self, owner: str, job: str) -> list[tables.FileRow]:
        """What a job made, by path."""
        return jobs.list_files(self._database, owner, _require_known_name(job, "job"))

    def file(self, owner: str, job: str, path: str) -> tuple[tables.FileRow, Path]:
        """One file that a job made and where its content lies."""
        return self._one(self.files(owner, job), path)

    def cancel(self, owner: str, job: str) -> tables.JobRow:
        """Wish that a job ends; one that is over stays as it is, a part of one that is not is InUse."""
        with self._deleting(owner):
            return self._ledger.cancel(owner, _require_known_name(job, "job"))

    def delete_job(self, owner: str, job: str) -> None:
        """Delete a job with all that it made, for good; if it runs, it is stopped."""
        with self._deleting(owner):
            deletion.delete_job(self._database, self.store.blobs, owner, _require_known_name(job, "job"))

    # The whole

    def counts(self) -> dict[State, int]:
        """Jobs of all owners by state, for monitoring."""
        return jobs.count_by_state(self._database)

    def check(self) -> None:
        """Whether database and disk answer; StoreUnavailable says which does not."""
        self.store.check()

    def require_room(self, more: int = 0) -> None:
        """Raise StoreFull where so many bytes more would take what is kept for jobs that run."""
        self.store.require_room(self.settings.reserve_mb * 1_000_000 + more)

    def close(self) -> None:
        """Give all connections back."""
        self.store.close()

    @contextmanager
    def _deleting(self, owner: str) -> abc.Iterator[None]:
        with self.store.spare.given_up():
            yield
        self.quotas.forget(owner)

    def _one(self, files: list[tables.FileRow], name: str) -> tuple[tables.FileRow, Path]:
        for file in files:
            if file.name == name:
                return file, self.store.blobs.path(file.sha256)
        raise NotFound(f"there is no file '{name[:100]}'", field="name", remedy="List the files")


def open_store(settings: ServiceSettings) -> Store:
    """The store of the settings, its tables brought up to date."""
    url = settings.database_url
    return Store.open(settings.data_directory, None if url is None else url.get_secret_value())


def _require_known_name(name: str, what: str) -> str:
    """A name that something can have; others count as not found before a database sees them."""
    if not name.isprintable():
        raise NotFound(f"there is no such {what}", field=what)
    return name
