"""Keys open what is theirs; lists show what is their owner's."""

from __future__ import annotations

import re

import pytest
from sqlalchemy import select

from scaling_service.core.errors import InputError
from scaling_service.documents.jobs import State
from scaling_service.service.store import jobs, keys, subjects
from scaling_service.service.store.errors import NotFound
from scaling_service.service.store.store import Store
from scaling_service.service.store.tables import api_keys
from tests.service.store.fixtures import upload
from tests.service.store.rows import add_job, add_many


def test_a_key_opens_until_it_is_revoked(store: Store) -> None:
    assert not keys.has_valid(store.database)
    row, secret = keys.create(store.database, "lab", "the laboratory's computer")
    other, other_secret = keys.create(store.database, "other")
    assert keys.find_owner(store.database, secret) == "lab"
    assert keys.find_owner(store.database, other_secret) == "other"
    keys.revoke(store.database, row.id)
    assert keys.find_owner(store.database, secret) is None
    assert keys.find_owner(store.database, other_secret) == "other"
    valid = {k.id: k.revoked_us is None for k in keys.list_all(store.database)}
    assert valid == {row.id: False, other.id: True}
    with pytest.raises(NotFound):
        keys.revoke(store.database, row.id)


def test_the_secret_is_not_kept(store: Store) -> None:
    _, secret = keys.create(store.database, "lab")
    with store.read() as connection:
        (row,) = connection.execute(select(api_keys)).all()
    assert secret.split("_", 2)[2] not in " ".join(map(str, row))
    assert re.fullmatch(r"[0-9a-f]{64}", row.secret_sha256)


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s[:-1],
        lambda s: s + "x",
        lambda _s: "",
        lambda _s: "scs_x_y",
        lambda s: s.replace("scs", "abc"),
        lambda s: "é" + s,
    ],
)
def test_nothing_but_the_key_opens(sqlite_store: Store, change: object) -> None:
    _, secret = keys.create(sqlite_store.database, "lab")
    assert callable(change)
    assert keys.find_owner(sqlite_store.database, change(secret)) is None


def test_an_owner_has_a_printable_name(sqlite_store: Store) -> None:
    for name in ("", "  ", "a\nb", "x" * 201):
        with pytest.raises(InputError):
            keys.create(sqlite_store.database, name)


def test_owners_do_not_see_each_other(store: Store) -> None:
    for owner in ("lab", "other"):
        subjects.put(store.database, owner, "S01", f'"{owner}"')
        upload(store, owner, "S01", f"{owner}.trc", owner.encode())
    job = add_job(store, "lab", "{}", subjects=("S01",), outputs={"a": b"a"})
    with store.read() as connection:
        assert subjects.read_document(connection, "other", "S01") == '"other"'
    assert [file.name for file in subjects.list_files(store.database, "other", "S01")] == ["other.trc"]
    for look in (jobs.get, jobs.read_documents, jobs.list_files):
        with pytest.raises(NotFound):
            look(store.database, "other", job)
    assert jobs.list_page(store.database, "other").items == ()
    assert jobs.list_page(store.database, "other", subject="S01").items == ()
    assert [row.id for row in jobs.list_page(store.database, "lab", subject="S01").items] == [job]


def test_pages_hold_every_job_once_newest_first(store: Store) -> None:
    names = add_many(store, "lab", 120)
    add_many(store, "other", 30)
    for filters, expected in (
        ({}, names[::-1]),
        ({"state": State.DONE}, [n for k, n in enumerate(names) if list(State)[k % 6] is State.DONE][::-1]),
        ({"kind": "landmarks"}, names[::10][::-1]),
    ):
        found, cursor = list[str](), None
        while True:
            page = jobs.list_page(store.database, "lab", cursor=cursor, limit=7, **filters)  # type: ignore[arg-type]
            found += [row.id for row in page.items]
            cursor = page.following
            if cursor is None:
                break
        assert found == expected


def test_a_page_stays_where_it_was_while_jobs_arrive(sqlite_store: Store) -> None:
    names = add_many(sqlite_store, "lab", 10)
    first = jobs.list_page(sqlite_store.database, "lab", limit=4)
    add_job(sqlite_store, "lab", "new")
    second = jobs.list_page(sqlite_store.database, "lab", cursor=first.following, limit=4)
    assert [row.id for row in second.items] == names[::-1][4:8]


@pytest.mark.parametrize("wrong", [{"cursor": "x"}, {"cursor": "%%"}, {"limit": 0}, {"limit": 501}])
def test_wrong_pages_are_refused(sqlite_store: Store, wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        jobs.list_page(sqlite_store.database, "lab", **wrong)  # type: ignore[arg-type]


def test_a_subject_has_so_many_files_at_most(sqlite_store: Store) -> None:
    subjects.put(sqlite_store.database, "lab", "S01", "{}")
    for k in range(3):
        with sqlite_store.incoming(10) as incoming:
            incoming.write(b"x")
            content = incoming.finish()
            attach = (sqlite_store.database, sqlite_store.blobs, "lab", "S01", f"{k}", content)
            if k < 2:
                subjects.attach(*attach, most=2)
            else:
                with pytest.raises(InputError, match="2 files already"):
                    subjects.attach(*attach, most=2)
    with sqlite_store.incoming(10) as incoming:  # one of the same name is replaced all the same
        subjects.attach(
            sqlite_store.database, sqlite_store.blobs, "lab", "S01", "1", incoming.finish(), most=2
        )
    assert [file.size for file in subjects.list_files(sqlite_store.database, "lab", "S01")] == [1, 0]
