"""Tasks: reproducible results, storage and resumption."""

from __future__ import annotations

import gc
import warnings
from pathlib import Path

import pytest
from evaluation import jobs
from evaluation.comparison import Trial, localize
from evaluation.jobs import Task, Workers, configuration_identity, run_tasks
from support.evaluations import CALIBRATION, QUICK, condition
from support.quick_task import quick_task

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.errors import ParameterError
from tactile_localizer.resources import PACKAGE


def task(seed: int, configuration: Configuration = QUICK[0].configuration) -> Task:
    return Trial(condition(seed), configuration, CALIBRATION).task(localize)


def test_a_dask_cluster_of_processes_gives_the_same_results(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="dask[distributed] is not installed")
    tasks = [quick_task(seed) for seed in (1, 2, 3)]
    here = run_tasks(tasks, tmp_path / "here", Workers(1))
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, local_directory=tmp_path
    ) as cluster:
        there = run_tasks(tasks, tmp_path / "there", Workers(dask=cluster.scheduler_address))
    assert here == there
    assert len(here) == 3


def test_a_run_resumes_with_the_missing_tasks(tmp_path: Path) -> None:
    tasks = [quick_task(seed) for seed in (1, 2)]
    first = run_tasks(tasks, tmp_path, Workers(1))
    kept, lost = (tmp_path / f"{one.key}.json" for one in tasks)
    written = kept.stat().st_mtime_ns
    lost.unlink()
    fractions: list[float] = []
    again = run_tasks(tasks, tmp_path, Workers(1), lambda text, fraction: fractions.append(fraction))
    assert fractions == [1.0]
    assert kept.stat().st_mtime_ns == written
    assert again == first


def test_results_before_a_failure_are_kept(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected at least 0"):
        run_tasks([quick_task(1), quick_task(-1)], tmp_path, Workers(1))
    assert [file.name for file in tmp_path.iterdir()] == [f"{quick_task(1).key}.json"]


@pytest.mark.filterwarnings("error")
@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_a_failed_run_prints_no_warnings(tmp_path: Path) -> None:
    def interrupt(text: str, fraction: float) -> None:
        raise KeyboardInterrupt

    with warnings.catch_warnings():  # python-can leaks sockets of badly configured buses
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()
    with pytest.raises(KeyboardInterrupt):
        run_tasks([quick_task(seed) for seed in (1, 2, 3, 4)], tmp_path, Workers(2), interrupt)
    gc.collect()


def test_equal_tasks_run_once(tmp_path: Path) -> None:
    fractions: list[float] = []
    run_tasks([quick_task(1)] * 2, tmp_path, Workers(1), lambda text, fraction: fractions.append(fraction))
    assert fractions == [1.0]


def test_a_key_depends_on_identity_and_sources() -> None:
    keys = {task(1).key, task(2).key, task(1, Configuration()).key}
    assert len(keys) == 3
    assert task(1).key in keys


@pytest.mark.parametrize("name", ["own_place", "own_package.place"])
def test_a_key_depends_on_the_sources_of_a_user_defined_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    file = tmp_path / f"{name.replace('.', '/')}.py"
    file.parent.mkdir(exist_ok=True)
    monkeypatch.syspath_prepend(tmp_path)
    own = Configuration(model=f"{name}:Place")
    keys = []
    for code in ("A = 1", "A = 2", "A = 2"):
        file.write_text(code)
        (file.parent / "__init__.py").touch()
        keys.append(Task(localize, (), {"configuration": configuration_identity(own)}).key)
    assert keys[0] != keys[1] == keys[2]
    assert configuration_identity(Configuration()) == vars(Configuration())
    assert "source" in configuration_identity(Configuration(model="missing_model:Place")), (
        "refused where it is built"
    )


def test_unavailable_workers_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "DASK_TIMEOUT_S", 1)
    with pytest.raises(ParameterError, match="jobs: expected at least 1, or -1 for one per core"):
        Workers(0)
    pytest.importorskip("distributed", reason="dask[distributed] is not installed")
    with pytest.raises(ParameterError, match=r"dask tcp://127.0.0.1:9: expected a scheduler"):
        run_tasks([quick_task(1)], tmp_path, Workers(dask="tcp://127.0.0.1:9"))


@pytest.mark.parametrize("part", jobs.RESULT_SOURCES)
def test_sources_that_invalidate_results_exist(part: str) -> None:
    assert (PACKAGE / part).exists()
