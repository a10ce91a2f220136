"""Settings from a file and the environment, shown without secrets, refused where they are unsafe."""

from __future__ import annotations

import ipaddress
import os
import stat
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import yaml
from pydantic import ValidationError
from sqlalchemy import make_url
from sqlalchemy.exc import ArgumentError

from scaling_service.core.errors import FileUnreadable, InputError
from scaling_service.service.jobs.settings import PREFIX, ServiceSettings

_ELSEWHERE = {f"{PREFIX}DATA", f"{PREFIX}DATASETS_URL", f"{PREFIX}WITHOUT_PAGE"}
"""Variables with the prefix that are for something else: where tests find recordings, where public ones are
downloaded, how a package is built."""

_ENCRYPTED = ("require", "verify-ca", "verify-full")
"""Of ``sslmode`` in a PostgreSQL URL (PostgreSQL manual, section 34.19)."""


class SettingsRefused(InputError):
    """A setting is unknown, cannot be used, or is unsafe."""


def load_settings(file: Path | None = None, **chosen: Any) -> ServiceSettings:
    """Settings as chosen here, else as in the environment, else as in a YAML file, else the defaults.

    Parameters
    ----------
    file : Path, optional
        A mapping of the fields of :class:`ServiceSettings`.
    **chosen
        Fields and values.

    Raises
    ------
    SettingsRefused
        A key or a variable is unknown, a value cannot be used, or what was chosen is unsafe.
    FileUnreadable
        The file cannot be read.
    """
    known = set(ServiceSettings.model_fields)
    ours = {name.upper() for name in os.environ if name.upper().startswith(PREFIX)} - _ELSEWHERE
    for name in sorted(ours):
        if name.removeprefix(PREFIX).lower() not in known:
            raise SettingsRefused(
                "there is no such setting", field=name, remedy="Print the settings to see their names"
            )
    written = {k: v for k, v in _read(file).items() if f"{PREFIX}{k.upper()}" not in ours}
    try:
        settings = ServiceSettings(**written | chosen)
    except ValidationError as error:
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


def shown(settings: ServiceSettings) -> dict[str, Any]:
    """Settings as plain values, passwords left out."""
    values = settings.model_dump(mode="json")
    if settings.database_url is not None:
        values["database_url"] = make_url(settings.database_url.get_secret_value()).render_as_string()
    return values


def refuse_unsafe(settings: ServiceSettings) -> None:
    """Stop before patients' data are open to others.

    Raises
    ------
    SettingsRefused
        Others may write to the data directory, or data would go over a network unencrypted.
    """
    folder = settings.data_directory
    if folder.is_dir() and folder.stat().st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise SettingsRefused(
            "other users may write to it", file=folder, field="data_directory", remedy=f"chmod 700 {folder}"
        )
    if not settings.trusted_network:
        _refuse_open_database(settings)
        _refuse_open_cluster(settings)


def _refuse_open_database(settings: ServiceSettings) -> None:
    if settings.database_url is None:
        return
    try:
        url = make_url(settings.database_url.get_secret_value())
    except ArgumentError:
        raise SettingsRefused(
            "this is no URL of a database",
            field="database_url",
            remedy="Use postgresql://user:password@host/name, or leave it out for SQLite",
        ) from None
    hosts = (url.host, *_texts(url.query.get("host")), *_texts(url.query.get("hostaddr")))
    if not all(map(is_here, hosts)) and url.query.get("sslmode") not in _ENCRYPTED:
        raise SettingsRefused(
            "the connection over the network is not encrypted",
            field="database_url",
            remedy="Add ?sslmode=verify-full to the URL, or set trusted_network where nobody can listen",
        )


def _refuse_open_cluster(settings: ServiceSettings) -> None:
    if settings.dask_address is None:
        return
    address = urlsplit(settings.dask_address)
    if address.scheme != "tls" and not is_here(address.hostname):
        raise SettingsRefused(
            f"whoever reaches {address.hostname} could run programs there",
            field="dask_address",
            remedy="Use a tls:// address, or set trusted_network where nobody else can connect",
        )


def _texts(value: str | tuple[str, ...] | None) -> tuple[str, ...]:
    return () if value is None else (value,) if isinstance(value, str) else value


def is_here(host: str | None) -> bool:
    """Whether a host is this machine: a loopback address, its name, or none (a Unix socket).

    Examples
    --------
    >>> is_here("127.0.0.1"), is_here("localhost"), is_here("db.example.org")
    (True, True, False)
    """
    if not host or host == "localhost" or host.startswith("/"):
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _read(file: Path | None) -> dict[str, Any]:
    if file is None:
        return {}
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileUnreadable(
            f"it cannot be read: {error.strerror}", file=file, remedy="Check the path"
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        said = str(error).splitlines()[0]
        raise FileUnreadable(
            f"it is not valid YAML: {said}", file=file, remedy="Write `key: value` lines"
        ) from None
    if not isinstance(content, dict | None):
        raise FileUnreadable("it is no mapping of settings", file=file, remedy="Write `key: value` lines")
    return content or {}
