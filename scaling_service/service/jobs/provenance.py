"""What is needed to get a result again, kept beside it."""

from __future__ import annotations

import json

from scaling_service.service.jobs.identity import canonical
from scaling_service.service.store.rows import JobRow


def provenance(row: JobRow, specification: str, code: str, host: str | None, wall_s: float) -> str:
    """The origin of a result, as JSON.

    Parameters
    ----------
    row : JobRow
    specification : str
        As asked for; its ``code_version`` is that of the day.
    code : str
        What computed.
    host : str or None
        Where.
    wall_s : float
        Of the last attempt.
    """
    told = json.loads(specification)
    settings = told["request"].get("settings", {})
    return canonical(
        {
            "code_version": code,
            "asked_code_version": told["code_version"],
            "kind": row.kind,
            "request": told["request"],
            "seed": settings.get("seed") if isinstance(settings, dict) else None,
            "input_hashes": told["inputs"],
            "host": host,
            "worker": row.worker,
            "attempts": row.attempt,
            "losses": row.losses,
            "wall_s": round(wall_s, 3),
        }
    )
