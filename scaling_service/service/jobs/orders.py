"""From a leased job to the order for an attempt at it."""

from __future__ import annotations

import json
from collections.abc import Sequence

from scaling_service.service.jobs.attempts import AttemptFolder, Order
from scaling_service.service.jobs.identity import code_version
from scaling_service.service.jobs.kinds import Kind
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.store import jobs, parts
from scaling_service.service.store.parts import PartRow
from scaling_service.service.store.rows import JobRow
from scaling_service.service.store.store import Store


def make_order(
    store: Store, settings: ServiceSettings, kind: Kind, row: JobRow, folder: AttemptFolder
) -> tuple[Order, str]:
    """The order, and the job's specification.

    Raises
    ------
    StoreUnavailable
        The database does not answer.
    NotFound
        The job was deleted meanwhile.
    """
    specification, _, _ = jobs.documents(store.database, row.owner, row.id)
    told = json.loads(specification)
    if kind.parts is None:
        inputs, ends = jobs.inputs(store.database, row.id), None
    else:
        inputs = parts.files(store.database, row.id, kind.parts.file)
        ends = _told(parts.ends(store.database, row.id))
    order = Order(
        kind=kind,
        request=json.dumps(told["request"]),
        documents=told["documents"],
        inputs=tuple((file.name, file.sha256) for file in inputs),
        data=store.blobs.folder,
        folder=folder.folder,
        limits=settings.limits,
        code_version=code_version(),
        patience_s=settings.lease_s,
        parts=ends,
    )
    return order, specification


def _told(ends: Sequence[PartRow]) -> str:
    """How the parts ended, as JSON, in their order."""
    told = [
        {
            "request": json.loads(end.specification)["request"],
            "state": end.state.value,
            "result": None if end.result is None else json.loads(end.result),
            "failure": None if end.failure is None else json.loads(end.failure),
        }
        for end in ends
    ]
    return json.dumps(told, ensure_ascii=False)
