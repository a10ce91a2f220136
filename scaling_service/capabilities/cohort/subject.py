"""One subject of a batch, from its file to its folder: done once, and not again unless something changed."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import TypeAdapter

from scaling_service.capabilities.cohort.document import RECORD
from scaling_service.capabilities.cohort.outcomes import Done, NothingPossible, select_possible_methods
from scaling_service.capabilities.cohort.summary import SubjectSummary, summarise
from scaling_service.capabilities.scaling.run import compare
from scaling_service.capabilities.scaling.saving import save
from scaling_service.capabilities.shared.settings import Settings
from scaling_service.capabilities.subject.reading import hash_input_files, load_subject
from scaling_service.core.errors import InputError
from scaling_service.core.progress import Progress
from scaling_service.documents.reading import read_document
from scaling_service.documents.results import ComparisonDocument
from scaling_service.documents.writing import code_version
from scaling_service.model.subject import Subject

RECORD_VERSION = 1
"""Part of every specification: raised when a summary holds other things than before."""

_COMPUTING = 0.85  # chosen: about computing's share of a subject's time, before its files are written


@dataclass(frozen=True, slots=True)
class Record:
    """That a subject is done: in SI with every digit, so that another run gives the same.

    ``specification`` is the SHA-256 of everything that the results depend on; ``files`` are what was written,
    relative to the subject's folder.
    """

    specification: str
    files: tuple[str, ...]
    summary: SubjectSummary


_RECORDS = TypeAdapter(Record)


@dataclass(frozen=True, slots=True, kw_only=True)
class SubjectMember:
    """How to scale the subject of a file, and where to write its results.

    ``force`` does it again even if nothing changed; a subject whose file cannot be used fails by its
    ``error`` without any work.
    """

    name: str
    file: Path
    folder: Path
    shown: str = ""
    groups: Mapping[str, str] = field(default_factory=dict)
    force: bool = False
    error: InputError | None = None

    def work(self, methods: Sequence[str] | None, settings: Settings, progress: Progress) -> Done:
        """Scale by the methods that are possible, and write what ``compare`` writes.

        NothingPossible: none of the methods can be done. InputError: whatever in the subject's files cannot
        be used, or a folder that cannot be written to.
        """
        if self.error is not None:
            raise self.error
        subject = load_subject(self.file)
        possible, left_out = select_possible_methods(subject, methods)
        if not possible:
            raise NothingPossible("; ".join(f"{method}: {why}" for method, why in left_out.items()))
        specified = hash_inputs(self.file, subject, methods, settings)
        known = None if self.force else read_record(self.folder)
        if known is not None and known.specification == specified:
            return Done(known.summary, kept=True)
        results = compare(
            self.file, possible, settings, progress=lambda what, share: progress(what, _COMPUTING * share)
        )
        # Gone before the first new file is there: a record never speaks for other files than its own.
        (self.folder / RECORD).unlink(missing_ok=True)
        document = save(
            results,
            self.folder,
            progress=lambda what, share: progress(what, _COMPUTING + (1.0 - _COMPUTING) * share),
        )
        summary = summarise(results, left_out=left_out)
        _write_record(self.folder, Record(specified, _list_files(document), summary))
        return Done(summary)


def hash_inputs(file: Path, subject: Subject, methods: Sequence[str] | None, settings: Settings) -> str:
    """SHA-256 of what a subject's results depend on.

    The subject document counts as it is understood, not as it is written: comments and order change nothing.
    Every file that it names counts by its content.
    """
    inputs = hash_input_files(subject, file)
    del inputs[file.resolve().name]
    content = {
        "record": RECORD_VERSION,
        "code": code_version(),
        "document": read_document(file).model_dump(mode="json"),
        "inputs": inputs,
        "methods": None if methods is None else list(methods),
        "settings": settings.resolved(),
        "seed": settings.seed,
    }
    text = json.dumps(content, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def read_record(folder: Path) -> Record | None:
    """What an earlier batch kept of a subject; None where it is absent, not whole, or its files are gone."""
    try:
        record = _RECORDS.validate_json((folder / RECORD).read_bytes())
    except (OSError, ValueError):  # absent, no JSON, or not this record: a ValidationError is a ValueError
        return None
    return record if all((folder / name).is_file() for name in record.files) else None


def read_summary(folder: Path) -> SubjectSummary:
    """What the statistics take of a subject that is done, whose other files need not be there."""
    return _RECORDS.validate_json((folder / RECORD).read_bytes()).summary


def _write_record(folder: Path, record: Record) -> None:
    """Written beside and moved into place, so that there is never half of one."""
    new = folder / f".{RECORD}.{os.getpid()}"
    new.write_text(json.dumps(_RECORDS.dump_python(record)) + "\n", encoding="utf-8")
    new.replace(folder / RECORD)


def _list_files(document: ComparisonDocument) -> tuple[str, ...]:
    by_method = [
        f"{m.method}/{name}" for m in document.methods.values() for name in (*m.files, "scaling.json")
    ]
    return ("comparison.json", *by_method)
