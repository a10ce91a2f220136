"""Files from a public repository, each checked against its SHA-256."""

from __future__ import annotations

from collections import abc
from functools import partial
from pathlib import Path
from urllib.parse import quote, urlsplit

import pooch
import requests

from scaling_service.capabilities.datasets import catalogue
from scaling_service.core import errors

pooch.get_logger().setLevel("ERROR")  # its own lines stay off the terminal; the caller says what happens

TIMEOUT_S = (10.0, 30.0)
"""To connect, and without any data; chosen: a slow link still answers, a dead one shows within a minute."""

_CHUNK_BYTES = 1 << 16  # chosen: the progress moves several times a second on a slow link

Received = abc.Callable[[int], None]

_AGAIN = "Try again: files that came are kept"
_ON_THE_WAY: tuple[tuple[type[requests.RequestException], str, str], ...] = (
    (
        requests.exceptions.ProxyError,
        "the proxy on the way to {host} does not answer",
        "Check HTTPS_PROXY and HTTP_PROXY",
    ),
    (
        requests.exceptions.SSLError,
        "the certificate of {host} cannot be verified",
        "Name your organisation's certificates in REQUESTS_CA_BUNDLE, or another address by --base-url",
    ),
    (requests.Timeout, "{host} does not answer in time", f"{_AGAIN}; or name another address by --base-url"),
    (
        requests.ConnectionError,
        "{host} cannot be reached",
        "Check the network (HTTPS_PROXY names a proxy), or name another address by --base-url",
    ),
    (requests.RequestException, "the download from {host} broke off", _AGAIN),
)
"""Kind of failure, problem and remedy, the particular before the general."""


class DownloadFailed(errors.InputError):
    """A file cannot be had from where it should be, or is not the one that was asked for."""


def find_default_cache() -> Path:
    """Where downloads are kept between runs: the system's folder for such files."""
    return Path(pooch.os_cache("scaling-service"))


def check_base_url(base_url: str) -> str:
    """The address without a trailing slash.

    Raises InputError: it is no http or https address.
    """
    try:
        parts = urlsplit(base_url.strip())
        usable = parts.scheme in ("http", "https") and bool(parts.hostname)
    except ValueError:
        usable = False
    if not usable:
        raise errors.InputError(
            f"'{base_url}' is not a web address",
            field="--base-url",
            remedy=f"Give one that starts with https://, such as {catalogue.BASE_URL}",
        )
    return base_url.strip().rstrip("/")


def make_remote_url(base_url: str, repository: str, commit: str, path: str) -> str:
    """The address of one file at one commit.

    Examples
    --------
    >>> make_remote_url("https://host", "owner/name", "c0ffee", "a folder/a.trc")
    'https://host/owner/name/c0ffee/a%20folder/a.trc'
    """
    return f"{base_url}/{repository}/{commit}/{quote(path)}"


def has_hash(path: Path, sha256: str) -> bool:
    """Whether the file is there with this content.

    Raises FileUnreadable: it is there and cannot be read.
    """
    try:
        return path.is_file() and pooch.file_hash(str(path), alg="sha256") == sha256
    except OSError as error:
        raise errors.FileUnreadable(
            f"it is there but cannot be read: {error.strerror}", file=path, remedy="Move it away"
        ) from None


def fetch(url: str, file: catalogue.RemoteFile, cache: Path, received: Received) -> Path:
    """The cached file, downloaded unless it is there with the right content.

    Nothing that is incomplete or wrong stays: a file appears in the cache once its SHA-256 was checked.

    ``file``: ``saved_as`` names it in the cache. ``cache``: folder; made if it does not exist.
    ``received``: called with the number of bytes of this file that have come so far. Raises DownloadFailed:
    no network, no such file, a connection that broke, or another content. Raises InputError: the cache
    cannot be written to.
    """
    try:
        pooch.retrieve(
            url,
            known_hash=f"sha256:{file.sha256}",
            fname=file.saved_as,
            path=cache,
            downloader=partial(_download, file, received),
        )
    except requests.RequestException as error:
        # What went wrong on the way, in plain words
        host = urlsplit(url).netloc
        if isinstance(error, requests.HTTPError) and error.response is not None:
            if error.response.status_code in (404, 410):
                layout = "<address>/<owner>/<name>/<commit>/<path>"
                problem, remedy = (
                    f"{url} is not there (HTTP {error.response.status_code})",
                    f"Check the address: files are looked for at {layout}",
                )
            else:
                problem, remedy = (
                    f"{url} was refused (HTTP {error.response.status_code})",
                    "Try again later, or name another address by --base-url",
                )
        else:
            problem, remedy = next((p, r) for kind, p, r in _ON_THE_WAY if isinstance(error, kind))
        raise DownloadFailed(
            problem.format(host=host), file=file.saved_as, field="--base-url", remedy=remedy
        ) from None
    except OSError as error:
        raise errors.InputError(
            f"downloads cannot be kept there: {error.strerror or error}",
            file=cache,
            field="--cache",
            remedy="Free some space, or name a folder that can be written to",
        ) from None
    return cache / file.saved_as


def _download(
    file: catalogue.RemoteFile, received: Received, url: str, output_file: str, _pooch: object
) -> None:
    """Download to a scratch file, which pooch deletes if this raises.

    Pooch's own downloader leaves connections open on errors, and does not stop at the size that is known.
    """
    size = 0
    with (
        requests.get(url, stream=True, timeout=TIMEOUT_S) as response,
        Path(output_file).open("wb") as scratch,
    ):
        response.raise_for_status()
        for chunk in response.iter_content(_CHUNK_BYTES):
            size += len(chunk)
            if size > file.bytes:
                raise _report_another(url, file, f"more than {file.bytes} bytes")
            scratch.write(chunk)
            received(size)
    found = pooch.file_hash(output_file, alg="sha256")
    if found != file.sha256:
        raise _report_another(url, file, f"SHA-256 {found}, {size} bytes")


def _report_another(url: str, file: catalogue.RemoteFile, found: str) -> DownloadFailed:
    return DownloadFailed(
        f"what {url} gave is not the published file and was deleted: "
        f"expected SHA-256 {file.sha256}, {file.bytes} bytes; found {found}",
        file=file.saved_as,
        field="sha256",
        remedy="Try again later, or name another address by --base-url; "
        "a network's sign-in page can be the cause, too",
    )
