"""Independent tasks on the cores of this machine or on a dask cluster, with stored results.

The result of a task depends on its arguments only: they seed the random numbers, and every worker uses one
thread. An interrupted run resumes with the missing tasks.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import joblib

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.likelihood.user_defined import SEPARATOR
from tactile_localizer.errors import ParameterError
from tactile_localizer.offline.json_file import plain, write_json
from tactile_localizer.resources import PACKAGE

Progress = Callable[[str, float], None]

DASK_TIMEOUT_S = 5
RESULT_SOURCES = ("core", "io", "sim", "offline", "scene.py", "channels.py")
"""Parts of the package that results depend on, beside this folder."""


@dataclass(frozen=True)
class Task:
    """A function call whose result is stored.

    Parameters
    ----------
    function : function that can be imported by name and returns values that JSON can hold
    arguments : arguments of the call
    identity : values that JSON can hold and that determine the result
    """

    function: Callable[..., dict[str, Any]]
    arguments: tuple[Any, ...]
    identity: dict[str, Any]

    @cached_property
    def key(self) -> str:
        """Name of the result's file: a digest of the identity, the function and the package's sources."""
        text = json.dumps([self.function.__qualname__, plain(self.identity), source_digest()], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Workers:
    """Workers for the tasks.

    Parameters
    ----------
    jobs : processes on this machine; -1: one per core
    dask : address of a dask scheduler to use instead
    """

    jobs: int = 1
    dask: str | None = None

    def __post_init__(self) -> None:
        if self.jobs < 1 and self.jobs != -1:
            raise ParameterError(f"jobs: expected at least 1, or -1 for one per core, got {self.jobs}")


def run_tasks(
    tasks: Sequence[Task],
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
    text: str = "evaluating",
) -> list[dict[str, Any]]:
    """Results of the tasks in order; stored results in ``folder`` are reused.

    An interrupt ends the workers too.

    Raises
    ------
    ParameterError
        The dask cluster cannot be reached.
    """
    files = {task.key: folder / f"{task.key}.json" for task in tasks}
    missing = {task.key: task for task in tasks if not files[task.key].exists()}
    done = len(files) - len(missing)
    if missing:
        with _backend(workers):
            calls = [joblib.delayed(task.function)(*task.arguments) for task in missing.values()]
            with _quietly_closed(joblib.Parallel(return_as="generator", batch_size=1)(calls)) as results:
                for (key, task), result in zip(missing.items(), results, strict=True):
                    write_json(files[key], {"task": task.identity, "result": result})
                    done += 1
                    if progress is not None:
                        progress(text, done / len(files))
    # New results are also read from their files, so that all have the same types.
    return [json.loads(files[task.key].read_text(encoding="utf-8"))["result"] for task in tasks]


@cache
def source_digest() -> str:
    """Digest of the sources that results depend on, so that results of other versions are not reused."""
    return _digest([*(PACKAGE / part for part in RESULT_SOURCES), Path(__file__).parent])


def configuration_identity(configuration: Configuration) -> dict[str, Any]:
    """Values that identify a configuration: its fields, and a digest of a user-defined model's sources.

    The sources are the module, or all modules of the package, without their imports.
    """
    choices = vars(configuration)
    if SEPARATOR not in configuration.model:
        return choices
    top = configuration.model.partition(SEPARATOR)[0].partition(".")[0]
    spec = importlib.util.find_spec(top) if top else None
    places = [] if spec is None else spec.submodule_search_locations or [spec.origin or ""]
    return {**choices, "source": _digest(map(Path, places))}


def _digest(places: Iterable[Path]) -> str:
    """Digest of Python files and of those in folders."""
    digest = hashlib.sha256()
    for place in places:
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(file.read_bytes() if file.is_file() else b"")
    return digest.hexdigest()


def _backend(workers: Workers) -> AbstractContextManager[Any]:
    if workers.dask is not None:
        return _dask(workers.dask)
    # A single job runs in this process.
    return joblib.parallel_config("loky", n_jobs=workers.jobs, inner_max_num_threads=1)


@contextmanager
def _quietly_closed(results: Generator[Any, None, None]) -> Iterator[Iterator[Any]]:
    """Context of the results in order; suppresses joblib's warning if they are not consumed."""
    try:
        yield results
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            results.close()


@contextmanager
def _dask(address: str) -> Iterator[None]:
    try:
        from distributed import Client
    except ImportError:
        raise ParameterError("dask: expected dask[distributed], not installed") from None
    try:
        client = Client(address, timeout=DASK_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"dask {address}: expected a scheduler, {' '.join(str(error).split())}"
        ) from None
    with client, joblib.parallel_config("dask", client=client):
        yield
