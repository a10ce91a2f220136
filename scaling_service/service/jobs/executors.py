"""Where attempts run: any ``concurrent.futures.Executor`` will do.

An attempt is a call of ``attempts.carry_out``, which watches over a limited process of its own. So the
executor's own workers only wait; threads are enough on one machine.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, TypeAlias, TypeVar

from scaling_service.core.errors import DependencyMissing
from scaling_service.service.jobs.settings import ServiceSettings
from scaling_service.service.sandbox.launcher import launcher
from scaling_service.service.store.errors import StoreUnavailable

Result = TypeVar("Result")
MakeExecutor: TypeAlias = Callable[[], Executor]
"""Called again when an executor broke."""

_CONNECT_S = 10.0
"""Chosen: a scheduler that does not answer by then is tried again later."""


def executor_maker(settings: ServiceSettings) -> MakeExecutor:
    """The executor that the settings ask for: a Dask cluster where an address is given, else this machine."""
    address = settings.dask_address
    if address is None:
        return lambda: local_executor(settings.workers)
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise DependencyMissing(
            "Dask is not installed",
            field="dask_address",
            remedy="Install it with `pip install 'scaling-service[dask]'`",
        ) from error
    return lambda: ClusterExecutor(distributed, address)


def local_executor(workers: int) -> Executor:
    """Threads on this machine: each watches over one attempt, which computes in a process of its own."""
    launcher().start()
    return ThreadPoolExecutor(workers, thread_name_prefix="attempt")


class ClusterExecutor(Executor):
    """A Dask cluster, by its scheduler's address. Its workers need this package and the data directory."""

    def __init__(self, distributed: Any, address: str) -> None:
        try:
            self._client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError) as error:
            raise StoreUnavailable(
                "the Dask scheduler does not answer",
                field="dask_address",
                remedy="Start it; the service goes on by itself",
            ) from error
        # Not pure: the same order may be carried out twice. No retries: what is lost is our own matter.
        self._executor = self._client.get_executor(pure=False, retries=0)

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> Future[Result]:
        """Run a call on one of the workers."""
        future: Future[Result] = self._executor.submit(fn, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:  # noqa: ARG002 (the base's)
        """Leave the cluster; it goes on for others."""
        self._executor.shutdown(wait=wait)
        self._client.close()
