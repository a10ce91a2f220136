"""Whose request it is. A key belongs to an owner; without keys there is only the machine's own user."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Annotated, TypeVar
from urllib.parse import urlsplit

from fastapi import Depends, Request
from starlette.concurrency import run_in_threadpool

from scaling_service.service.http.buckets import Buckets
from scaling_service.service.http.problems import KeyNeeded, TooManyRequests, WrongHost
from scaling_service.service.http.tickets import PARAMETER, Tickets
from scaling_service.service.jobs.configuration import is_here
from scaling_service.service.jobs.service import Service
from scaling_service.service.store import keys

T = TypeVar("T")

LOCAL = "local"
"""Owner of what is asked without a key, which only the machine's own users can, while there is no key."""

_FAILURES = 10
"""Wrong keys of one address that may come at once. Chosen: more than typing errors, far from guessing."""


class Callers:
    """Who may ask.

    Parameters
    ----------
    service : Service
    loopback : bool
        Whether only this machine reaches the service.
    """

    def __init__(self, service: Service, *, loopback: bool) -> None:
        self._database, self._loopback = service.store.database, loopback
        settings = service.settings
        self._requests = Buckets(settings.request_rate, settings.request_burst)
        self._failures = Buckets(1.0, _FAILURES)
        self.tickets = Tickets()

    def owner(self, request: Request) -> str:
        """The owner on whose behalf a request comes; it asks the store, so call it in a thread.

        Raises
        ------
        WrongHost, KeyNeeded, TooManyRequests
        """
        self._check_host(request)
        address = request.client.host if request.client else "unix"
        token = _token(request)
        ticket = request.query_params.get(PARAMETER) if request.method == "GET" else None
        if token is None and ticket is not None:
            owner, caller = self._of_ticket(ticket, request.scope["path"]), address
        elif token is None:
            owner, caller = self._without_key(), address
        else:
            owner = self._of_key(token, address)
            caller = hashlib.sha256(token.encode()).hexdigest()
            request.scope["caller"] = token.split("_")[1]  # the key's public part, for the log
        wait_s = self._requests.take(caller)
        if wait_s > 0.0:
            raise TooManyRequests(wait_s)
        return owner

    async def look(self, request: Request, see: Callable[[str], T]) -> T:
        """What the owner of a request sees, in one visit of a thread: for what is asked most often.

        Raises
        ------
        WrongHost, KeyNeeded, TooManyRequests
        """
        return await run_in_threadpool(lambda: see(self.owner(request)))

    def _check_host(self, request: Request) -> None:
        """A page of another site cannot make a browser on this machine ask under that site's name."""
        named = urlsplit(f"//{request.headers.get('host', '')}").hostname
        if self._loopback and (not named or not is_here(named)):
            raise WrongHost(
                "this service answers under the names of this machine only",
                field="Host",
                remedy="Ask 127.0.0.1 or localhost",
            )

    def _without_key(self) -> str:
        if self._loopback and not keys.any_valid(self._database):
            return LOCAL
        raise KeyNeeded(
            "a key is needed",
            field="Authorization",
            remedy="Send `Authorization: Bearer KEY`; `scaling-service keys create OWNER` makes one",
        )

    def _of_ticket(self, ticket: str, path: str) -> str:
        owner = self.tickets.owner_of(ticket, path)
        if owner is None:
            raise KeyNeeded(
                "this link does not work any more", field=PARAMETER, remedy="Open it again where it came from"
            )
        return owner

    def _of_key(self, token: str, address: str) -> str:
        wait_s = self._failures.wait_s(address)
        if wait_s > 0.0:
            raise TooManyRequests(wait_s)
        owner = keys.owner_of(self._database, token)
        if owner is None:
            self._failures.take(address)
            raise KeyNeeded(
                "this key opens nothing",
                field="Authorization",
                remedy="It is wrong or was revoked: `scaling-service keys list` shows those that are valid",
            )
        return owner


def _token(request: Request) -> str | None:
    given = request.headers.get("authorization")
    if given is None:
        return None
    scheme, _, token = given.partition(" ")
    if scheme.lower() != "bearer":
        raise KeyNeeded(
            "only bearer keys are known", field="Authorization", remedy="Send `Authorization: Bearer KEY`"
        )
    return token.strip()


async def _owner(request: Request) -> str:
    callers: Callers = request.app.state.callers
    return await run_in_threadpool(callers.owner, request)


async def _callers(request: Request) -> Callers:
    callers: Callers = request.app.state.callers
    return callers


async def _service(request: Request) -> Service:
    service: Service = request.app.state.service
    return service


Owner = Annotated[str, Depends(_owner)]
"""Of a route: the owner whose things it may see."""

Asked = Annotated[Callers, Depends(_callers)]
"""Of a route that finds out by itself who asks."""

Desk = Annotated[Service, Depends(_service)]
"""Of a route: what it asks."""
