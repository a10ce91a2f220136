"""What must never happen: a defect in answering a request."""

from __future__ import annotations

import logging

from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from scaling_service.core.errors import InputError
from scaling_service.service.http.problems import problem_response

log = logging.getLogger(__name__)


class Shield:
    """Middleware: a defect ends as a problem document, and its place in the code in the log.

    Parameters
    ----------
    app : ASGIApp
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on; what goes wrong after the answer began ends the connection."""
        begun = False

        async def sending(message: Message) -> None:
            nonlocal begun
            begun = True
            await send(message)

        try:
            await self._app(scope, receive, sending)
        except ClientDisconnect:
            return
        except Exception as error:  # noqa: BLE001 (whatever it is, the client gets an answer)
            log.error("a request failed", extra={"error": type(error).__name__, "at": _places(error)})
            if begun:
                raise _CutShort from None
            defect = InputError(
                "the program failed on this request",
                remedy="Report it; the service's log says where it happened",
            )
            await problem_response(defect, 500)(scope, receive, send)


class _CutShort(Exception):
    """An answer could not be brought to its end; the connection is closed so that the client notices."""


def _places(error: BaseException) -> str:
    """Where it broke: lines of code only, for a message may hold what a client sent."""
    found, trace = [], error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        found.append(f"{code.co_filename}:{trace.tb_lineno} {code.co_name}")
        trace = trace.tb_next
    return " < ".join(reversed(found))[:2000]
