"""Where a batch's work runs: in this process, or spread over worker processes that tell how far they are."""

from __future__ import annotations

import itertools
import multiprocessing
import signal
import threading
import typing
from collections import abc
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from multiprocessing.synchronize import Event

from scaling_service.core import threads

if typing.TYPE_CHECKING:
    from multiprocessing.queues import Queue

    Messages = Queue[tuple[str, str, float] | None]

P = typing.ParamSpec("P")
T = typing.TypeVar("T")

Listener = abc.Callable[[str, str, float], None]
"""Called with a subject's name, what is being done, and the share that is done, 0 to 1."""

_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


def report_stage(name: str, what: str, share: float) -> None:
    """Say from within a task how far it is; raises KeyboardInterrupt where the batch is being stopped."""
    listener = _LISTENER.get()
    if listener is not None:
        listener(name, what, share)


@contextmanager
def workers(count: int, listener: Listener | None = None) -> abc.Iterator[Executor]:
    """An executor for a batch: this process for one worker, else a pool of spawned processes.

    Worker processes use one thread of linear algebra each, unless the environment says otherwise. When
    the block is left by an interruption, tasks under way end when they next report their stage. The listener
    hears how far each task is, perhaps from another thread.
    """
    with _here(listener) if count == 1 else _pool(count, listener) as executor:
        yield executor


def run_in_processes(
    work: abc.Callable[..., T],
    tasks: abc.Iterable[tuple[object, ...]],
    count: int,
    finished: abc.Callable[[T, int], None] | None = None,
) -> list[T]:
    """Results of a module's function for every tuple of arguments, in order, by so many workers.

    ``finished`` is called with each result as it comes, and how many there are.
    """
    ended = itertools.count(1)

    def announce(future: Future[T]) -> None:
        if finished is not None and not future.cancelled() and future.exception() is None:
            finished(future.result(), next(ended))

    with workers(count) as executor:
        futures = []
        for task in tasks:
            future = executor.submit(work, *task)
            future.add_done_callback(announce)
            futures.append(future)
        return [future.result() for future in futures]


@contextmanager
def _here(listener: Listener | None) -> abc.Iterator[Executor]:
    token = _LISTENER.set(listener)
    try:
        yield threads.Serial()
    finally:
        _LISTENER.reset(token)


@contextmanager
def _pool(count: int, listener: Listener | None) -> abc.Iterator[Executor]:
    threads.use_one_thread()  # inherited by the workers, before they import numpy
    context = multiprocessing.get_context("spawn")
    messages: Messages = context.Queue()
    stop = context.Event()
    relay = threading.Thread(target=_relay, args=(messages, listener), daemon=True)
    executor = ProcessPoolExecutor(
        count, mp_context=context, initializer=_prepare_worker, initargs=(messages, stop)
    )
    relay.start()
    try:
        yield executor
    except BaseException:
        stop.set()
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
        messages.put(None)
        relay.join()
        messages.close()


def _relay(messages: Messages, listener: Listener | None) -> None:
    while (message := messages.get()) is not None:
        if listener is not None:
            listener(*message)


def _prepare_worker(messages: Messages, stop: Event) -> None:
    """Let a worker tell how far it is, and leave an interruption to the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def send(name: str, what: str, share: float) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        messages.put((name, what, share))

    _LISTENER.set(send)
