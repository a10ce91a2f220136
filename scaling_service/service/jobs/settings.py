"""All that can be chosen for a service: from a file and the environment, refused where it is unsafe."""

from __future__ import annotations

import ipaddress
import json
import os
import stat
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pydantic
from pydantic_settings import BaseSettings, SettingsConfigDict
from sqlalchemy import make_url
from sqlalchemy.exc import ArgumentError

from scaling_service.core import errors
from scaling_service.documents.reading import read_content
from scaling_service.service.sandbox.limits import Limits

PREFIX = "SCALING_SERVICE_"
_MB = 1_000_000

FIRST, LAST = 5, 15
"""Niceness of processes that compute (sched(7)): of an owner's first check, and of others. Chosen: both give
way to whoever answers requests on the same processors; where they share one, the first has nine tenths."""

_ELSEWHERE = {f"{PREFIX}DATA", f"{PREFIX}DATASETS_URL", f"{PREFIX}WITHOUT_PAGE"}
"""Variables with the prefix that are for something else: where tests find recordings, where public ones are
downloaded, how a package is built."""

_ENCRYPTED = ("require", "verify-ca", "verify-full")
"""Of ``sslmode`` in a PostgreSQL URL (PostgreSQL manual, section 34.19)."""


class SettingsRefused(errors.InputError):
    """A setting is unknown, cannot be used, or is unsafe."""


class ServiceSettings(BaseSettings):
    """Settings of the service and its runners.

    A variable ``SCALING_SERVICE_WORKERS`` sets ``workers``, and so on; it wins over the file.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, extra="forbid", frozen=True)

    data_directory: Path = pydantic.Field(
        default=Path("scaling-service-data"),
        description="Where everything is kept; only for the service's user.",
    )
    database_url: pydantic.SecretStr | None = pydantic.Field(
        default=None, description="PostgreSQL, postgresql://user:password@host/name; else SQLite in the data."
    )
    dask_address: str | None = pydantic.Field(
        default=None,
        description="Scheduler of a Dask cluster that shares the data directory; else this machine.",
    )
    trusted_network: bool = pydantic.Field(
        default=False, description="Whether database and cluster may be reached without encryption."
    )
    host: str = pydantic.Field(
        default="127.0.0.1", min_length=1, description="Address to listen on; others than loopback need keys."
    )
    port: int = pydantic.Field(
        default=8000, ge=0, le=65535, description="Port to listen on; 0 takes a free one."
    )
    tls_certificate: Path | None = pydantic.Field(
        default=None, description="PEM file; with tls_key, HTTPS is spoken."
    )
    tls_key: Path | None = pydantic.Field(default=None, description="PEM file.")
    request_rate: float = pydantic.Field(
        default=100.0, gt=0, description="Requests a second of each key or address, in the long run."
    )
    request_burst: int = pydantic.Field(
        default=500, ge=1, description="Requests that may come at once before that."
    )
    workers: int = pydantic.Field(
        default=os.cpu_count() or 1, ge=1, le=1024, description="Jobs at the same time."
    )
    lease_s: float = pydantic.Field(
        default=30.0, ge=1.0, le=3600.0, description="A runner not heard of for longer is lost."
    )
    most_losses: int = pydantic.Field(
        default=10, ge=1, le=1000, description="A job that lost so many processes to outside causes fails."
    )
    limit_memory_mb: int = pydantic.Field(default=4000, ge=100, description="Of each process of a job.")
    limit_cpu_s: float = pydantic.Field(
        default=3600.0, ge=1.0, description="Processor time of each process of a job."
    )
    limit_check_cpu_s: float = pydantic.Field(
        default=120.0, ge=1.0, description="Processor time of each process of a look at files."
    )
    limit_wall_s: float = pydantic.Field(default=7200.0, ge=1.0, description="Time of a job.")
    limit_file_mb: int = pydantic.Field(default=1000, ge=1, description="Each file that a job writes.")
    limit_output_mb: int = pydantic.Field(default=2000, ge=1, description="All that a job writes.")
    limit_upload_mb: int = pydantic.Field(default=1000, ge=1, description="Each uploaded file.")
    limit_streams: int = pydantic.Field(
        default=200, ge=1, description="Uploads, downloads and followed jobs of an owner at once."
    )
    limit_stream_s: float = pydantic.Field(
        default=3600.0, ge=1.0, description="Whole time of each; who follows a job asks again."
    )
    limit_subjects: int = pydantic.Field(default=10_000, ge=1, description="Subjects of an owner.")
    limit_files: int = pydantic.Field(default=1000, ge=1, description="Files of a subject.")
    limit_queue: int = pydantic.Field(default=10_000, ge=1, description="Waiting jobs of an owner.")
    limit_owner_mb: int = pydantic.Field(
        default=100_000, ge=1, description="All files of an owner, uploaded or made, each content once."
    )
    reserve_mb: int = pydantic.Field(
        default=500, ge=0, description="With less room on the disk no job begins and no upload goes on."
    )
    retention_days: float | None = pydantic.Field(
        default=None, gt=0, description="Jobs and subjects older than this are deleted; none unless given."
    )

    def choose_limits(self, *, brief: bool = False, first: bool = False) -> Limits:
        """What one job may use, one that is ``brief`` or not; ``first``: whether it goes before others."""
        return Limits(
            memory_bytes=self.limit_memory_mb * _MB,
            cpu_s=self.limit_check_cpu_s if brief else self.limit_cpu_s,
            cpu_setting="limit_check_cpu_s" if brief else "limit_cpu_s",
            niceness=FIRST if first else LAST,
            wall_s=self.limit_wall_s,
            file_bytes=self.limit_file_mb * _MB,
            output_bytes=self.limit_output_mb * _MB,
        )

    def with_secrets(self) -> str:
        """All settings as JSON for another process of the service; never to be shown or logged."""
        url = self.database_url
        secret = {"database_url": None if url is None else url.get_secret_value()}
        return json.dumps(self.model_dump(mode="json") | secret)


def load_settings(file: Path | None = None, **chosen: Any) -> ServiceSettings:
    """Settings as chosen here, else as in the environment, else as in a YAML file, else the defaults.

    SettingsRefused where a key or a variable is unknown, a value cannot be used, or the whole is unsafe.
    """
    ours = {name.upper() for name in os.environ if name.upper().startswith(PREFIX)} - _ELSEWHERE
    for name in sorted(ours):
        if name.removeprefix(PREFIX).lower() not in ServiceSettings.model_fields:
            raise SettingsRefused(
                "there is no such setting", field=name, remedy="Print the settings to see their names"
            )
    written = {k: v for k, v in _read(file).items() if f"{PREFIX}{k.upper()}" not in ours}
    try:
        settings = ServiceSettings(**written | chosen)
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        raise SettingsRefused(
            f"it cannot be used: {first['msg']}",
            file=file if field in written else None,
            field=field,
            remedy="Print the settings to see what is possible",
        ) from None
    refuse_unsafe(settings)
    return settings


def without_passwords(settings: ServiceSettings) -> dict[str, Any]:
    """Settings as plain values, passwords left out."""
    values = settings.model_dump(mode="json")
    if settings.database_url is not None:
        values["database_url"] = make_url(settings.database_url.get_secret_value()).render_as_string()
    return values


def refuse_unsafe(settings: ServiceSettings) -> None:
    """Stop before patients' data are open to others, on the disk or on a network."""
    folder = settings.data_directory
    if folder.is_dir() and folder.stat().st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise SettingsRefused(
            "other users may write to it", file=folder, field="data_directory", remedy=f"chmod 700 {folder}"
        )
    if settings.trusted_network:
        return
    if settings.database_url is not None:
        try:
            url = make_url(settings.database_url.get_secret_value())
        except ArgumentError:
            raise SettingsRefused(
                "this is no URL of a database",
                field="database_url",
                remedy="Use postgresql://user:password@host/name, or leave it out for SQLite",
            ) from None
        query = url.normalized_query
        hosts = (url.host, *query.get("host", ()), *query.get("hostaddr", ()))
        if not all(map(is_loopback, hosts)) and url.query.get("sslmode") not in _ENCRYPTED:
            raise SettingsRefused(
                "the connection over the network is not encrypted",
                field="database_url",
                remedy="Add ?sslmode=verify-full to the URL, or set trusted_network where nobody can listen",
            )
    if settings.dask_address is not None:
        address = urlsplit(settings.dask_address)
        if address.scheme != "tls" and not is_loopback(address.hostname):
            raise SettingsRefused(
                f"whoever reaches {address.hostname} could run programs there",
                field="dask_address",
                remedy="Use a tls:// address, or set trusted_network where nobody else can connect",
            )


def is_loopback(host: str | None) -> bool:
    """Whether a host is this machine: a loopback address, its name, or none (a Unix socket).

    Examples
    --------
    >>> is_loopback("127.0.0.1"), is_loopback("localhost"), is_loopback("db.example.org")
    (True, True, False)
    """
    if not host or host == "localhost" or host.startswith("/"):
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _read(file: Path | None) -> dict[str, Any]:
    try:
        content = {} if file is None else read_content(file) or {}
    except errors.SubjectInvalid as error:
        raise errors.FileUnreadable(
            error.problem, file=file, field=error.field, remedy=error.remedy
        ) from None
    if not isinstance(content, dict):
        raise errors.FileUnreadable(
            "it is no mapping of settings", file=file, remedy="Write `key: value` lines"
        )
    return content
