"""Calls in this process, in several of this machine, or on the workers of a Dask cluster."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from tactile_localizer import __version__
from tactile_localizer.errors import ParameterError, TactileLocalizerError, in_one_line

Progress = Callable[[str, float], None]

_CONNECT_S = 10.0
"""Time in which a scheduler has to answer, s."""
_POLL_S = 1.0
"""Time after which the workers are counted, s."""
_WITHOUT_WORKERS_S = 60.0
"""Time without any worker after which what is not finished is lost, s: a job system may start others."""
_RETRIES = 1
"""Repetitions of a call that fails by an error that is not ours, as of a file system."""


class Lost(str):
    """Reason why a call has no result, though it was valid: the process that made it is gone."""

    __slots__ = ()


def in_parallel(
    function: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    *,
    jobs: int = 1,
    cluster: str | None = None,
    progress: Progress | None = None,
    what: str = "replaying",
) -> Iterator[tuple[int, Any]]:
    """Results of calls as soon as each is finished, with its number; a :class:`Lost` where there is none.

    Parameters
    ----------
    function : called with the arguments and, last, a function to report its progress or ``None``
    arguments : of each call
    jobs : processes on this machine, with one thread each; -1: one per core
    cluster : address of a Dask scheduler, whose workers are used instead
    progress : called with ``what`` and the fraction of all calls that is completed

    Raises
    ------
    ParameterError
        An invalid number of jobs, or no scheduler answers.
    TactileLocalizerError
        That of a call; the others are not made.
    """
    if jobs < 1 and jobs != -1:
        raise ParameterError(f"jobs: expected at least 1, or -1 for one per core, got {jobs}")
    report = progress or (lambda _what, _done: None)
    if cluster is None and jobs == 1:
        for number, each in enumerate(arguments):
            yield number, function(*each, _part_of(report, number, len(arguments)))
            report(what, (number + 1) / len(arguments))
        return
    found = _on_cluster(function, arguments, cluster) if cluster else _in_processes(function, arguments, jobs)
    for done, result in enumerate(found, 1):
        report(what, done / len(arguments))
        yield result


def _part_of(report: Progress, number: int, calls: int) -> Progress:
    """Progress of one of the calls as progress of all of them."""
    return lambda what, done: report(what, (number + done) / calls)


def _in_processes(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], jobs: int
) -> Iterator[tuple[int, Any]]:
    import joblib
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    missing = set(range(len(arguments)))
    calls = [joblib.delayed(_numbered)(number, function, each) for number, each in enumerate(arguments)]
    with joblib.parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1):
        try:
            for number, result in joblib.Parallel(return_as="generator_unordered", batch_size=1)(calls):
                missing.remove(number)
                yield number, result
        except TerminatedWorkerError:  # by a signal, as where memory is short: the others end with it
            yield from ((number, Lost("a process was killed")) for number in sorted(missing))


def _numbered(number: int, function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[int, Any]:
    return number, function(*arguments, None)


def _on_cluster(
    function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], address: str
) -> Iterator[tuple[int, Any]]:
    """The futures of distributed, not joblib's backend for it, which ends all calls where one is lost."""
    import distributed

    try:
        client = distributed.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"--cluster {address}: expected a dask scheduler, {in_one_line(error)}"
        ) from None
    with client:
        pending = {
            client.submit(_checked, __version__, function, each, pure=False, retries=_RETRIES): number
            for number, each in enumerate(arguments)
        }
        seen_s = time.monotonic()
        while pending:
            with contextlib.suppress(distributed.TimeoutError):
                distributed.wait(list(pending), timeout=_POLL_S, return_when="FIRST_COMPLETED")
            for future in [each for each in pending if each.done()]:
                with contextlib.suppress(distributed.TimeoutError):  # its worker is gone: it is made again
                    yield pending[future], _result(future)
                    del pending[future]
            if _has_workers(client):
                seen_s = time.monotonic()
            elif time.monotonic() - seen_s > _WITHOUT_WORKERS_S:
                reason = Lost(f"the cluster has had no worker for {_WITHOUT_WORKERS_S:.0f} s")
                yield from ((number, reason) for number in sorted(pending.values()))
                return


def _checked(version: str, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Result of a call on a worker, which has to have the same version of the package."""
    if version != __version__:
        raise ParameterError(f"worker: expected tactile_localizer {version}, found {__version__}")
    return function(*arguments, None)


def _result(future: Any) -> Any:
    """Result of a finished future, or why it is lost; raises the errors of the package."""
    if future.status == "finished":
        return future.result(timeout=_POLL_S)
    error = future.exception() if future.status == "error" else None
    if isinstance(error, TactileLocalizerError):
        raise error
    return Lost(in_one_line(error) if error is not None else f"the call was {future.status}")


def _has_workers(client: Any) -> bool:
    with contextlib.suppress(OSError, ValueError):  # the scheduler is gone
        return client.status == "running" and bool(client.scheduler_info()["workers"])
    return False
