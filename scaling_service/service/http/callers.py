"""Whose request it is. A key belongs to an owner; without keys there is only the machine's own user.

A link that browsers follow carries a ticket in place of a key: they stream downloads and open reports by
plain links. How many requests a caller may make is bounded.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Annotated
from urllib.parse import urlsplit

import fastapi

from scaling_service.service.http import problems
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import is_loopback
from scaling_service.service.store import keys, links

LOCAL = "local"
"""Owner of what is asked without a key, which only the machine's own users can, while there is no key."""

PARAMETER = "ticket"

MOST_CALLERS = 10_000
"""Callers remembered. Chosen: a megabyte; the one unseen for longest is forgotten, and may begin anew."""


class Callers:
    """Who may ask; ``loopback`` says whether only this machine reaches the service."""

    def __init__(self, service: Service, *, loopback: bool) -> None:
        self._database, self._loopback = service.store.database, loopback
        self._limit = RateLimit(service.settings.request_rate, service.settings.request_burst)

    def owner(self, request: fastapi.Request) -> str:
        """The owner on whose behalf a request comes; it asks the store, so call it in a thread.

        A refused request counts for its address, any other for its key: wrong keys lock out no right one.
        """
        # A page of another site cannot make a browser on this machine ask under that site's name.
        if self._loopback and not _is_this_machine(request.headers.get("host", "")):
            raise problems.WrongHost(
                "this service answers under the names of this machine only",
                field="Host",
                remedy="Ask 127.0.0.1 or localhost",
            )
        address = request.client.host if request.client else "unix"
        try:
            owner, caller = self._recognise(request, address)
        except (problems.KeyNeeded, problems.ForeignOrigin):
            self._count(address)
            raise
        self._count(caller)
        return owner

    def _recognise(self, request: fastapi.Request, address: str) -> tuple[str, str]:
        """The owner, and who it is whose requests are counted."""
        given = request.headers.get("authorization")
        if given is not None:
            return self._check_key(request, given)
        ticket = request.query_params.get(PARAMETER) if request.method == "GET" else None
        if ticket is not None:
            owner = links.find_owner(self._database, ticket, request.scope["path"])
            if owner is None:
                raise problems.KeyNeeded(
                    "this link does not work any more",
                    field=PARAMETER,
                    remedy="Open it again where it came from",
                )
            return owner, f"links of {owner}"
        if not self._loopback or keys.has_valid(self._database):
            remedy = "Send `Authorization: Bearer KEY`; `scaling-service keys create OWNER` makes one"
            raise problems.KeyNeeded("a key is needed", field="Authorization", remedy=remedy)
        if request.method not in ("GET", "HEAD") and _is_foreign(request):
            raise problems.ForeignOrigin(
                "a page of another site may change nothing here",
                field="Origin",
                remedy="Use the service's own page, or a program; pages of other sites need a key",
            )
        return LOCAL, address

    def _count(self, caller: str) -> None:
        wait_s = self._limit.take(caller)
        if wait_s > 0.0:
            raise problems.TooManyRequests(wait_s)

    def _check_key(self, request: fastapi.Request, given: str) -> tuple[str, str]:
        scheme, _, token = given.partition(" ")
        if scheme.lower() != "bearer":
            raise problems.KeyNeeded(
                "only bearer keys are known", field="Authorization", remedy="Send `Authorization: Bearer KEY`"
            )
        owner = keys.find_owner(self._database, token.strip())
        if owner is None:
            raise problems.KeyNeeded(
                "this key opens nothing",
                field="Authorization",
                remedy="It is wrong or was revoked: `scaling-service keys list` shows those that are valid",
            )
        request.scope["caller"] = token.split("_")[1]  # the key's public part, for the log
        return owner, f"key {request.scope['caller']}"


def _is_this_machine(host: str) -> bool:
    try:
        name = urlsplit(f"//{host}").hostname
    except ValueError:
        return False
    return bool(name) and is_loopback(name)


def _is_foreign(request: fastapi.Request) -> bool:
    """Whether a page of another site asks (Fetch standard; Fetch Metadata Request Headers)."""
    headers = request.headers
    origin = headers.get("origin")
    if origin is not None and origin.partition("://")[2] != headers.get("host"):
        return True
    return headers.get("sec-fetch-site", "none") not in ("same-origin", "none")


def _find_owner(request: fastapi.Request) -> str:
    callers: Callers = request.app.state.callers
    return callers.owner(request)


async def _find_service(request: fastapi.Request) -> Service:
    service: Service = request.app.state.service
    return service


Owner = Annotated[str, fastapi.Depends(_find_owner)]  # of a route: the owner whose things it may see

ServiceDep = Annotated[Service, fastapi.Depends(_find_service)]  # of a route: what it asks


class RateLimit:
    """Each caller may make ``burst`` requests at once, and ``rate`` a second in the long run.

    The generic cell rate algorithm (ITU-T I.371, annex A): a request moves the moment at which the caller
    may make a whole burst again.

    Examples
    --------
    >>> now = 0.0
    >>> limit = RateLimit(rate=2.0, burst=1, clock=lambda: now)
    >>> limit.take("a"), limit.take("a"), limit.take("b")
    (0.0, 0.5, 0.0)
    """

    def __init__(self, rate: float, burst: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._each_s, self._burst_s, self._clock = 1.0 / rate, burst / rate, clock
        self._lock = threading.Lock()
        self._rested_at: dict[str, float] = {}

    def take(self, caller: str) -> float:
        """Count a request: 0; or do not, and tell the seconds until one may come."""
        now_s = self._clock()
        with self._lock:
            before = max(self._rested_at.pop(caller, now_s), now_s)
            wait_s = before + self._each_s - now_s - self._burst_s
            allowed = wait_s <= 1e-9  # s: of rounding
            self._rested_at[caller] = before + self._each_s if allowed else before
            if len(self._rested_at) > MOST_CALLERS:
                del self._rested_at[next(iter(self._rested_at))]
        return 0.0 if allowed else wait_s
