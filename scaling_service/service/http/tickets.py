"""Tickets for links that carry no key: browsers stream downloads and open reports by plain links."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets
import time

LIFETIME_S = 60
"""Within which a link must be opened. Chosen: a click follows at once; a slow machine has time."""

PARAMETER = "ticket"


class Tickets:
    """Makes tickets for one owner and one path, and checks them; those of another process are worthless."""

    def __init__(self) -> None:
        self._secret = secrets.token_bytes(32)

    def issue(self, owner: str, path: str, *, now_s: float | None = None) -> tuple[str, int]:
        """A ticket.

        Parameters
        ----------
        owner : str
        path : str
            Of the address, decoded.
        now_s : float, optional
            Seconds since 1970; the clock's unless given.

        Returns
        -------
        ticket : str
        until_s : int
            Seconds since 1970 at which it ends.
        """
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
