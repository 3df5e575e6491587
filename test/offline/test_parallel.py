"""Calls in processes and on a cluster."""

from functools import partial
from pathlib import Path

import pytest
from support.cluster import answer, cluster_of, open_scan

from tactile_localizer.errors import ParameterError, ScanError
from tactile_localizer.offline import parallel
from tactile_localizer.offline.parallel import Lost, in_parallel


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_have_the_numbers_of_their_calls(jobs: int) -> None:
    steps: list[float] = []
    report = lambda _what, done: steps.append(done)  # noqa: E731
    found = dict(in_parallel(answer, [(3.0,), ("b",)], jobs=jobs, progress=report))
    assert found == {0: 3.0, 1: "b"}
    assert steps == [0.5, 1.0]


def test_a_process_that_is_killed_loses_its_call_by_name() -> None:
    found = dict(in_parallel(answer, [(None,)] * 2, jobs=2))
    assert found.keys() == {0, 1}
    assert all(isinstance(each, Lost) and each == "a process was killed" for each in found.values())


@pytest.mark.slow
def test_what_a_cluster_without_workers_has_not_finished_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with cluster_of(1, tmp_path) as cluster:
        run = partial(in_parallel, cluster=cluster.address)
        assert sorted(run(answer, [(1,), (2,)])) == [(0, 1), (1, 2)]
        with pytest.raises(ScanError, match="no_such_scan: expected a scan folder"):
            list(run(open_scan, [("no_such_scan",)]))
        monkeypatch.setattr(parallel, "_WITHOUT_WORKERS_S", 1.0)
        assert list(run(answer, [(None,)])) == [(0, "the cluster has had no worker for 1 s")]
    with pytest.raises(ParameterError, match=r"--cluster 127.0.0.1:9: expected a dask scheduler, "):
        list(run(answer, [(1,)], cluster="127.0.0.1:9"))


def test_the_number_of_processes_is_checked() -> None:
    with pytest.raises(ParameterError, match="jobs: expected at least 1, or -1 for one per core, got 0"):
        list(in_parallel(answer, [(1,)], jobs=0))
