"""Jobs in a store, made without a runner."""

from __future__ import annotations

import hashlib
from typing import Any

from sqlalchemy import insert

from scaling_service.documents.jobs import State
from scaling_service.service.store import blobs, jobs
from scaling_service.service.store.blobs import prepare
from scaling_service.service.store.database import NowUs
from scaling_service.service.store.jobs import NewJob
from scaling_service.service.store.keys import ensure_owner
from scaling_service.service.store.store import Store
from scaling_service.service.store.tables import FileRow
from scaling_service.service.store.tables import jobs as table


def add_job(
    store: Store,
    owner: str,
    specification: str,
    *,
    subjects: tuple[str, ...] = (),
    inputs: tuple[FileRow, ...] = (),
    outputs: dict[str, bytes] | None = None,
    **columns: Any,
) -> str:
    """A job; with outputs it is done."""
    identity = hashlib.sha256(f"{owner}{specification}".encode()).hexdigest()
    new = NewJob(
        id=identity,
        owner=owner,
        kind="tiny",
        code_version="1",
        specification=specification,
        subjects=subjects,
        inputs=inputs,
    )
    with store.write() as connection:
        jobs.add(connection, new, State.QUEUED.value)
        if outputs is not None:
            contents = {}
            for path, content in outputs.items():
                scratch = store.blobs.uploads / hashlib.sha256(path.encode()).hexdigest()
                scratch.write_bytes(content)
                contents[path] = prepare(scratch)
            blobs.keep(connection, store.blobs, contents.values())
            jobs.add_files(connection, identity, [FileRow(p, c.sha256, c.size) for p, c in contents.items()])
            columns = {"state": State.DONE.value, "finished_us": NowUs()} | columns
        if columns:
            jobs.change(connection, identity, columns)
    return identity


def add_many(store: Store, owner: str, number: int, **columns: Any) -> list[str]:
    """Many rows of jobs at once, one every µs."""
    names = [hashlib.sha256(f"{owner}{k}".encode()).hexdigest() for k in range(number)]
    specification = '{"kind":"tiny","request":{"text":"' + 2000 * "x" + '"}}'
    rows = [
        {
            "id": name,
            "owner": owner,
            "kind": ("scaling", "landmarks")[k % 10 == 0],
            "state": list(State)[k % 6].value,
            "created_us": 1_700_000_000_000_000 + k,
            "updated_us": 1_700_000_000_000_000 + k,
            "finished_us": 1_700_000_000_000_000 + k,
            "code_version": "1",
            "specification": specification,
            "result": specification,
        }
        | columns
        for k, name in enumerate(names)
    ]
    with store.write() as connection:
        ensure_owner(connection, owner)
        for k in range(0, number, 5000):
            connection.execute(insert(table), rows[k : k + 5000])
    return names
