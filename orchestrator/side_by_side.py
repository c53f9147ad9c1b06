"""Jobs in processes side by side: FMUs written in Python share one interpreter within a process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path


class Crew:
    """Processes that take one job after another; to be used in a ``with`` statement, which ends them.

    Args:
        size: How many; one for each core by default. Where there is one, jobs are done in this process.
    """

    def __init__(self, size: int | None = None):
        self._size = size or cores()
        self._executor: ProcessPoolExecutor | None = None
        self._others: set[multiprocessing.Process] = set()

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, kind: type[BaseException] | None, *details: object) -> None:
        if kind is not None and self._executor is not None:
            for process in set(multiprocessing.active_children()) - self._others:
                process.terminate()
        self._dismiss()

    def work(
        self,
        function: Callable,
        jobs: Sequence[tuple],
        started: Callable[[int], None],
        finished: Callable[[int, object, str | None], None],
    ) -> None:
        """Call ``function(*job)`` for each job. A job that fails leaves the others alone.

        Args:
            function: Known by name to other processes.
            jobs: Arguments of each call.
            started: Called with the number of each job that is begun.
            finished: Called with the number of each job that is done, what the function returned, and why it failed, None if it did not.
        """
        if min(self._size, len(jobs)) == 1 and self._executor is None:
            for i, job in enumerate(jobs):
                started(i)
                finished(i, *_attempt(function, job))
            return
        # No more than are worked on are handed over, so that it is known which those are.
        waiting, running = list(enumerate(jobs))[::-1], {}
        while waiting or running:
            while waiting and len(running) < self._size:
                i, job = waiting.pop()
                started(i)
                running[self._submit(function, job)] = i
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                i, error = running.pop(future), future.exception()
                if isinstance(error, BrokenProcessPool):
                    self._dismiss()
                finished(i, *((None, f"its process ended: {error or type(error).__name__}") if error else future.result()))

    def _submit(self, function: Callable, job: tuple) -> Future:
        if self._executor is None:
            self._others = set(multiprocessing.active_children())
            # Ctrl-C reaches all processes of a terminal: it ends those that work on a job through this one.
            context, ignore = multiprocessing.get_context("spawn"), (signal.SIGINT, signal.SIG_IGN)
            self._executor = ProcessPoolExecutor(self._size, mp_context=context, initializer=signal.signal, initargs=ignore)
        try:
            with _path_without_fmus():
                return self._executor.submit(_attempt, function, job)
        except BrokenProcessPool:  # another job's process has just ended
            self._dismiss()
            return self._submit(function, job)

    def _dismiss(self) -> None:
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _attempt(function: Callable, job: tuple) -> tuple[object, str | None]:
    """What a job comes to, and why it failed, in words: not every exception gets from one process to another."""
    try:
        return function(*job), None
    except Exception as error:  # whatever it is, the other jobs are not to be lost
        ours = type(error).__module__.startswith(("orchestrator", "cdl_fmu"))
        return None, f"{error}" if ours else f"{type(error).__name__}: {error}"


@contextmanager
def _path_without_fmus():
    """New processes inherit the path of modules: each FMU that this one ran has put its folder there, with a pythonfmu that builds none."""
    before = list(sys.path)
    sys.path[:] = [folder for folder in before if not Path(folder, "slavemodule.txt").exists()]
    try:
        yield
    finally:
        sys.path[:] = before
