"""API keys: made, shown once, kept only as a digest, revoked."""

from __future__ import annotations

import hashlib
import hmac
import secrets

import sqlalchemy as sa

from scaling_service.core.errors import InputError
from scaling_service.service.store import database as db
from scaling_service.service.store import tables
from scaling_service.service.store.errors import NotFound

PREFIX = "scs"  # starts every key, so that a key found in a text is known for one

_SHOWN = tuple(tables.api_keys.c[name] for name in tables.KeyRow.__dataclass_fields__)
_ANY_VALID = sa.select(tables.api_keys.c.id).where(tables.api_keys.c.revoked_us.is_(None)).limit(1)
_LONGEST = 200


def create(database: db.Database, owner: str, label: str = "") -> tuple[tables.KeyRow, str]:
    """Make a key of an owner, and its secret; several keys of one owner see the same things.

    The secret is to be shown once; only its SHA-256 is kept. (Its 256 random bits need no slow hash.)
    """
    for field, value, least in (("owner", owner, 1), ("label", label, 0)):
        if not least <= len(value.strip()) or len(value) > _LONGEST or not value.isprintable():
            raise InputError(
                f"'{value[:40]}' cannot be used", field=field, remedy=f"Give 1 to {_LONGEST} letters"
            )
    identity, secret = secrets.token_hex(6), secrets.token_urlsafe(32)
    token = f"{PREFIX}_{identity}_{secret}"
    with database.write() as connection:
        ensure_owner(connection, owner)
        made = {"id": identity, "owner": owner, "label": label, "secret_sha256": _digest(token)}
        connection.execute(sa.insert(tables.api_keys).values(made | {"created_us": db.NowUs()}))
        row = connection.execute(sa.select(*_SHOWN).where(tables.api_keys.c.id == identity)).mappings().one()
    return tables.KeyRow(**row), token


def find_owner(database: db.Database, token: str) -> str | None:
    """The owner whose key this is; None for one that is unknown or revoked."""
    parts = token.split("_", 2)
    if len(parts) != 3 or parts[0] != PREFIX or not (token.isascii() and token.isprintable()):
        return None
    wanted = sa.select(tables.api_keys.c.owner, tables.api_keys.c.secret_sha256).where(
        tables.api_keys.c.id == parts[1], tables.api_keys.c.revoked_us.is_(None)
    )
    with database.read() as connection:
        found = connection.execute(wanted).one_or_none()
    if found is None or not hmac.compare_digest(found.secret_sha256, _digest(token)):
        return None
    return str(found.owner)


def list_all(database: db.Database) -> list[tables.KeyRow]:
    """All keys, revoked ones too, oldest first."""
    with database.read() as connection:
        rows = connection.execute(
            sa.select(*_SHOWN).order_by(tables.api_keys.c.created_us, tables.api_keys.c.id)
        ).mappings()
        return [tables.KeyRow(**row) for row in rows]


def has_valid(database: db.Database) -> bool:
    """Whether a key exists that is not revoked."""
    with database.read() as connection:
        return connection.scalar(_ANY_VALID) is not None


def revoke(database: db.Database, identity: str) -> None:
    """Let a key open nothing any more, nor its owner's links; NotFound where no such key is valid."""
    valid = (tables.api_keys.c.id == identity) & tables.api_keys.c.revoked_us.is_(None)
    with database.write() as connection:
        done = connection.execute(sa.update(tables.api_keys).where(valid).values(revoked_us=db.NowUs()))
        of_key = sa.select(tables.api_keys.c.owner).where(tables.api_keys.c.id == identity)
        connection.execute(sa.delete(tables.links).where(tables.links.c.owner.in_(of_key)))
    if done.rowcount == 0:
        raise NotFound(f"there is no valid key '{identity}'", field="key", remedy="List the keys")


def ensure_owner(connection: sa.Connection, owner: str) -> None:
    """Make the owner's row if it is not there."""
    made = db.insert_for(connection)(tables.owners).values(name=owner, served_us=0)
    connection.execute(made.on_conflict_do_nothing())


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
