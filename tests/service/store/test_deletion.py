"""Deleting leaves no trace, and nothing of others is touched."""

from __future__ import annotations

from pathlib import Path

import pytest
from sqlalchemy import update

from scaling_service.service.store import deletion, jobs, subjects
from scaling_service.service.store.database import US_PER_S, NowUs
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.store import Store
from scaling_service.service.store.tables import jobs as job_table
from scaling_service.service.store.tables import subjects as subject_table
from tests.service.store.fixtures import upload
from tests.service.store.rows import add_job

SECRET = "Mrs Example of Rennes"


def traces(folder: Path) -> list[str]:
    """Files in which the text stands, whatever they are."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    named = [path.name for path in folder.rglob("*") if SECRET in path.name]
    return named + [path.name for path in files if SECRET.encode() in path.read_bytes()]


def patient(store: Store, owner: str = "lab", subject: str = "S01", content: str = SECRET) -> str:
    """A subject with a file, and a job with all that can be known of one; the job's name."""
    subjects.put(store.database, owner, subject, f'{{"note": "{content}"}}')
    file = upload(store, owner, subject, "walk.trc", content.encode() * 3000)
    job = add_job(
        store,
        owner,
        f'{{"request": "{content} {subject}"}}',
        subjects=(subject,),
        inputs=(file,),
        outputs={"report.html": f"<p>{content} {subject}</p>".encode() * 3000},
        result=f'"{content}"' * 3000,
        provenance=f'"{content}"',
        failure='{"kind": "X", "problem": "' + content + '"}',
        progress_what=content,
    )
    scratch = store.blobs.work / f"{job}.1" / "inputs"
    scratch.mkdir(parents=True)
    (scratch / "walk.trc").write_text(content)
    return job


def test_a_deleted_subject_leaves_no_trace(sqlite_store: Store) -> None:
    patient(sqlite_store)
    assert len(traces(sqlite_store.blobs.folder)) >= 4
    deletion.delete_subject(sqlite_store.database, sqlite_store.blobs, "lab", "S01")
    assert traces(sqlite_store.blobs.folder) == []


def test_a_deleted_job_leaves_no_trace_of_itself(sqlite_store: Store) -> None:
    job = patient(sqlite_store)
    deletion.delete_job(sqlite_store.database, sqlite_store.blobs, "lab", job)
    kept = traces(sqlite_store.blobs.folder)
    assert len(kept) == 2  # the subject's own file, and its document in the database
    subjects.detach(sqlite_store.database, sqlite_store.blobs, "lab", "S01", "walk.trc")
    subjects.put(sqlite_store.database, "lab", "S01", "{}")
    deletion.remove_traces(sqlite_store.database)
    assert traces(sqlite_store.blobs.folder) == []


def test_what_others_refer_to_stays(store: Store) -> None:
    patient(store, "lab", "S01", "shared")
    other = patient(store, "other", "S01", "shared")
    deletion.delete_subject(store.database, store.blobs, "lab", "S01")
    with pytest.raises(NotFound):
        subjects.get(store.database, "lab", "S01")
    (file,) = subjects.list_files(store.database, "other", "S01")
    assert store.blobs.path(file.sha256).read_bytes() == b"shared" * 3000
    assert [f.name for f in jobs.list_files(store.database, "other", other)] == ["report.html"]


def test_only_the_owner_can_delete(store: Store) -> None:
    job = patient(store)
    for delete, name in ((deletion.delete_job, job), (deletion.delete_subject, "S01")):
        with pytest.raises(NotFound):
            delete(store.database, store.blobs, "other", name)
    assert jobs.get(store.database, "lab", job).id == job


def test_what_is_older_than_it_may_get_is_deleted(store: Store) -> None:
    old, recent = patient(store, "lab", "S01"), patient(store, "lab", "S02")
    waiting = add_job(store, "lab", "{}", subjects=("S03",))
    subjects.put(store.database, "lab", "S03", "{}")
    two_days_ago = NowUs() - 2 * 86_400 * US_PER_S
    with store.write() as connection:
        connection.execute(update(subject_table).values(updated_us=two_days_ago))
        connection.execute(
            update(job_table).where(job_table.c.id.in_([old, waiting])).values(finished_us=two_days_ago)
        )
    assert deletion.expire(store.database, store.blobs, days=1.0) == (1, 1)
    assert [row.id for row in subjects.list_page(store.database, "lab").items] == ["S03", "S02"]
    with pytest.raises(NotFound):
        jobs.get(store.database, "lab", old)
    for job in (recent, waiting):
        assert jobs.get(store.database, "lab", job).id == job
    # The subject of the job that is still kept went with nothing but time: it stays until that job goes.
    assert deletion.expire(store.database, store.blobs, days=1.0) == (0, 0)
