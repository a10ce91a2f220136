"""Whose request it is. A key belongs to an owner; without keys there is only the machine's own user.

A link that browsers follow carries a ticket in place of a key: they stream downloads and open reports by
plain links. How many requests a caller may make is told by a token bucket for each.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Annotated, TypeVar
from urllib.parse import urlsplit

from fastapi import Depends, Request
from starlette.concurrency import run_in_threadpool

from scaling_service.service.http.problems import KeyNeeded, TooManyRequests, WrongHost
from scaling_service.service.jobs.service import Service
from scaling_service.service.jobs.settings import is_here
from scaling_service.service.store import keys

T = TypeVar("T")

LOCAL = "local"
"""Owner of what is asked without a key, which only the machine's own users can, while there is no key."""

LIFETIME_S = 60
"""Within which a link must be opened. Chosen: a click follows at once; a slow machine has time."""

PARAMETER = "ticket"

MOST_CALLERS = 10_000
"""Buckets kept. Chosen: a megabyte; the one unused for longest is forgotten, and was full again long ago."""

_FAILURES = 10
"""Wrong keys of one address that may come at once. Chosen: more than typing errors, far from guessing."""


class Callers:
    """Who may ask; ``loopback`` says whether only this machine reaches the service."""

    def __init__(self, service: Service, *, loopback: bool) -> None:
        self._database, self._loopback = service.store.database, loopback
        settings = service.settings
        self._requests = Buckets(settings.request_rate, settings.request_burst)
        self._failures = Buckets(1.0, _FAILURES)
        self.tickets = Tickets()

    def owner(self, request: Request) -> str:
        """The owner on whose behalf a request comes; it asks the store, so call it in a thread."""
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
        """What the owner of a request sees, in one visit of a thread: for what is asked most often."""
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
        remedy = "Send `Authorization: Bearer KEY`; `scaling-service keys create OWNER` makes one"
        raise KeyNeeded("a key is needed", field="Authorization", remedy=remedy)

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


Owner = Annotated[str, Depends(_owner)]  # of a route: the owner whose things it may see

Asked = Annotated[Callers, Depends(_callers)]  # of a route that finds out by itself who asks

Desk = Annotated[Service, Depends(_service)]  # of a route: what it asks


class Tickets:
    """Makes tickets for one owner and one path, and checks them; those of another process are worthless."""

    def __init__(self) -> None:
        self._secret = secrets.token_bytes(32)

    def issue(self, owner: str, path: str, *, now_s: float | None = None) -> tuple[str, int]:
        """A ticket for a decoded path, and the seconds since 1970 at which it ends."""
        until_s = int(time.time() if now_s is None else now_s) + LIFETIME_S
        return f"{until_s}.{_text(owner.encode())}.{self._sign(until_s, owner, path)}", until_s

    def owner_of(self, ticket: str, path: str, *, now_s: float | None = None) -> str | None:
        """The owner on whose behalf a ticket opens a path; None where it does not, or no more.

        Examples
        --------
        >>> tickets = Tickets()
        >>> ticket, _ = tickets.issue("lab", "/v1/jobs/1/files.zip")
        >>> tickets.owner_of(ticket, "/v1/jobs/1/files.zip"), tickets.owner_of(ticket, "/v1/jobs/2/files.zip")
        ('lab', None)
        """
        until, _, rest = ticket.partition(".")
        named, _, signed = rest.partition(".")
        if not (until.isascii() and until.isdecimal()) or len(until) > 12:
            return None
        try:
            owner = base64.urlsafe_b64decode(named.encode()).decode()
        except (ValueError, binascii.Error):
            return None
        good = hmac.compare_digest(self._sign(int(until), owner, path).encode(), signed.encode())
        return owner if good and (time.time() if now_s is None else now_s) <= int(until) else None

    def _sign(self, until_s: int, owner: str, path: str) -> str:
        content = "\n".join((str(until_s), _text(owner.encode()), _text(path.encode())))
        return _text(hmac.new(self._secret, content.encode(), hashlib.sha256).digest())


def _text(content: bytes) -> str:
    return base64.urlsafe_b64encode(content).decode()


class Buckets:
    """For each caller a bucket of ``burst`` tokens: a request takes one, and ``rate`` come back a second.

    Examples
    --------
    >>> now = 0.0
    >>> buckets = Buckets(rate=2.0, burst=1, clock=lambda: now)
    >>> buckets.take("a"), buckets.take("a"), buckets.take("b")
    (0.0, 0.5, 0.0)
    >>> now = 0.5
    >>> buckets.take("a")
    0.0
    """

    def __init__(self, rate: float, burst: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate, self._burst, self._clock = rate, float(burst), clock
        self._lock = threading.Lock()
        self._filled: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str) -> float:
        """Take a token; 0, or the seconds until there is one."""
        with self._lock:
            left = self._left(caller)
            enough = left >= 1.0
            self._filled[caller] = (left - 1.0 if enough else left, self._clock())
            self._filled.move_to_end(caller)
            if len(self._filled) > MOST_CALLERS:
                self._filled.popitem(last=False)
            return 0.0 if enough else (1.0 - left) / self._rate

    def wait_s(self, caller: str) -> float:
        """The seconds until there is a token; none is taken."""
        with self._lock:
            return max(0.0, 1.0 - self._left(caller)) / self._rate

    def _left(self, caller: str) -> float:
        left, since = self._filled.get(caller, (self._burst, self._clock()))
        return min(self._burst, left + (self._clock() - since) * self._rate)
