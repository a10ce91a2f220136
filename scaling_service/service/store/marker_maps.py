"""The labels that a laboratory gives to markers: one map for each owner."""

from __future__ import annotations

from sqlalchemy import insert, select, update

from scaling_service.service.store.clock import NowUs
from scaling_service.service.store.database import Database
from scaling_service.service.store.keys import ensure_owner
from scaling_service.service.store.rows import MarkerMapRow
from scaling_service.service.store.tables import marker_maps

_SHOWN = (marker_maps.c.document, marker_maps.c.updated_us)


def get(database: Database, owner: str) -> MarkerMapRow | None:
    """An owner's map; None where there is none."""
    with database.read() as connection:
        found = connection.execute(select(*_SHOWN).where(marker_maps.c.owner == owner)).one_or_none()
    return None if found is None else MarkerMapRow(**found._mapping)


def put(database: Database, owner: str, document: str) -> MarkerMapRow:
    """Keep an owner's map in place of the one before.

    Parameters
    ----------
    document : str
        JSON.
    """
    mine = marker_maps.c.owner == owner
    with database.write() as connection:
        ensure_owner(connection, owner)
        changed = connection.execute(
            update(marker_maps).where(mine).values(document=document, updated_us=NowUs())
        )
        if changed.rowcount == 0:
            connection.execute(insert(marker_maps).values(owner=owner, document=document, updated_us=NowUs()))
        return MarkerMapRow(**connection.execute(select(*_SHOWN).where(mine)).one()._mapping)
