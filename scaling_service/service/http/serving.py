"""From settings to a server that runs with its runner, and to its end."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import resource
import signal
import socket
import ssl
import sys
from collections.abc import Iterator
from types import FrameType

import h11
import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.h11_impl import H11Protocol

from scaling_service.core.errors import InputError
from scaling_service.service.http.app import create_app
from scaling_service.service.jobs import settings as jobs_settings
from scaling_service.service.jobs.process import RunnerProcess, log_as_json
from scaling_service.service.jobs.service import Service
from scaling_service.service.store import keys

log = logging.getLogger(__name__)

ENDING_S = 10
"""How long requests under way may take at the end. Chosen: uploads that are nearly there get through."""

HEAD_S = 10.0
"""Within which the head of a request must come. Chosen: longer than networks pause for a few packets."""

_ENOUGH_FILES = 65_536  # chosen: more connections than a machine serves
_OWN_FILES = 200  # of these, kept back for databases, uploads and logs. Chosen.
_BACKLOG = 512


def serve(settings: jobs_settings.ServiceSettings) -> None:
    """Serve until SIGTERM or SIGINT; then end tidily.

    Jobs that run are given back to the queue, and go on at the next start.
    """
    # Let this process have as many files open, and so connections, as the system allows.
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _ENOUGH_FILES if hard == resource.RLIM_INFINITY else min(hard, _ENOUGH_FILES)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, wanted), hard))
    with contextlib.closing(Service.open(settings)) as service:
        refuse_exposed(service)
        with _listen(settings) as listener:
            log_as_json()
            if not jobs_settings.is_loopback(settings.host) and settings.tls_key is None:
                log.warning("keys and data go unencrypted unless a proxy speaks HTTPS")
            runner = RunnerProcess(settings)
            runner.start()
            try:
                chosen = service.settings
                app = create_app(service, loopback=jobs_settings.is_loopback(chosen.host))
                config = configure_server(app, chosen)
                log_as_json("uvicorn", logging.WARNING)
                host, port = listener.getsockname()[:2]
                shown = f"[{host}]" if ":" in host else host
                scheme = "https" if chosen.tls_key is not None else "http"
                Server(config, f"Listening on {scheme}://{shown}:{port}, documented at /docs").run([listener])
            finally:
                runner.stop()


def refuse_exposed(service: Service) -> None:
    """Stop before everyone in the network can see everything, or where HTTPS cannot be spoken."""
    settings = service.settings
    _check_tls(settings)
    if not jobs_settings.is_loopback(settings.host) and not keys.has_valid(service.store.database):
        raise jobs_settings.SettingsRefused(
            f"whoever reaches {settings.host} could see and change everything, for there is no API key",
            field="host",
            remedy="Make one by `scaling-service keys create OWNER`, or listen on 127.0.0.1",
        )


def _check_tls(settings: jobs_settings.ServiceSettings) -> None:
    """Whether what HTTPS needs is there and can be used."""
    certificate, key = settings.tls_certificate, settings.tls_key
    if certificate is None and key is None:
        return
    try:
        if certificate is None or key is None:
            raise OSError("a certificate and its key are needed")
        ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(certificate, key)
    except OSError as error:  # ssl.SSLError is one
        raise jobs_settings.SettingsRefused(
            f"HTTPS cannot be spoken: {error}",
            file=certificate,
            field="tls_certificate",
            remedy="Give tls_certificate and tls_key as PEM files, or neither",
        ) from None


@contextlib.contextmanager
def _listen(settings: jobs_settings.ServiceSettings) -> Iterator[socket.socket]:
    try:
        family = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)[0][0]
        listener = socket.create_server(
            (settings.host, settings.port), family=family, backlog=_BACKLOG, reuse_port=False
        )
    except (OSError, UnicodeError) as error:
        raise InputError(
            f"{settings.host}:{settings.port} cannot be listened on: {error}",
            field="port",
            remedy="Choose another port or host, or end the program that uses it",
        ) from None
    with listener:
        # The event loop does so for sockets that it makes itself; else small answers wait 40 ms for company.
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        yield listener


class Server(uvicorn.Server):
    """A server that tells open event streams to end, and ends on a signal without passing it on.

    When it answers, it prints the line ``ready``.
    """

    def __init__(self, config: uvicorn.Config, ready: str) -> None:
        super().__init__(config)
        self._ready = ready

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Handle the signals that mean the end."""
        before = {
            number: signal.signal(number, self.handle_exit) for number in (signal.SIGTERM, signal.SIGINT)
        }
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End soon; at the second signal at once."""
        super().handle_exit(sig, frame)
        stopping: asyncio.Event = self.config.loaded_app.state.stopping
        asyncio.get_running_loop().call_soon_threadsafe(stopping.set)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to answer, and say so."""
        await super().startup(sockets)
        if self.started:
            sys.stdout.write(self._ready + "\n")
            sys.stdout.flush()


class PromptProtocol(H11Protocol):
    """HTTP/1.1 on connections that are closed where a request is begun and its head does not come."""

    _closing: asyncio.TimerHandle | None = None

    # uvicorn's protocols take a transport that is written to, asyncio's declare any
    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self._closing = self.loop.call_later(HEAD_S, transport.close)

    def data_received(self, data: bytes) -> None:
        """Wait no longer where the head is there, but for the rest of one that has begun."""
        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._wait_no_longer()
        elif self._closing is None:
            self._closing = self.loop.call_later(HEAD_S, self.transport.close)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._wait_no_longer()
        super().connection_lost(exc)

    def _wait_no_longer(self) -> None:
        if self._closing is not None:
            self._closing.cancel()
            self._closing = None


def limit_connections() -> int:
    """As many as this process may have open files, but for those of its own."""
    most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return max(most - _OWN_FILES, most // 2)


def configure_server(app: FastAPI, settings: jobs_settings.ServiceSettings) -> uvicorn.Config:
    """How the server behaves: bounds on connections, no word about itself."""
    return uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        http=PromptProtocol,
        limit_concurrency=limit_connections(),
        timeout_graceful_shutdown=ENDING_S,
        ssl_certfile=settings.tls_certificate,
        ssl_keyfile=settings.tls_key,
        ws="none",
    )
