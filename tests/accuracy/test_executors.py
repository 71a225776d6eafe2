"""Maps and Monte Carlo by other executors than our own processes: the same to the last bit, and the
executor stays open. By our own processes: tests/cli.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
import xarray as xr

from aacmm_pin import Arm, ErrorModel, accuracy_volume, map_workspace
from aacmm_pin.accuracy import volume, workspace
from aacmm_pin.effects import EncoderEccentricity
from tests.again import again


class Counting(Executor):
    """Hands on, and counts what it is given."""

    def __init__(self, executor: Executor) -> None:
        self.executor, self.jobs = executor, 0

    def submit(self, work: Any, /, *args: Any, **named: Any) -> Future[Any]:
        self.jobs += 1
        return self.executor.submit(work, *args, **named)


@pytest.fixture(scope="module", params=["threads", again("dask")])
def executor(request) -> Iterator[Counting]:
    if request.param == "threads":
        with ThreadPoolExecutor(2) as pool:
            yield Counting(pool)
        return
    distributed = pytest.importorskip(
        "distributed", reason="needs the extra aacmm-pin[distributed]"
    )
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert len(client.scheduler_info()["workers"]) == 2
        yield Counting(client.get_executor(pure=False))


def test_results_do_not_depend_on_the_executor(executor, monkeypatch):
    monkeypatch.setattr(workspace, "CELLS_AT_ONCE", 4)
    arm = Arm.load("sino6")
    model = ErrorModel(arm, (EncoderEccentricity(joint=3, values=(1e-4, 0.0), u=(5e-5, 5e-5)),))
    here, there = (map_workspace(model, (3, 3), 4, workers=w).data for w in (1, executor))
    del here.attrs["seconds"], there.attrs["seconds"]
    xr.testing.assert_identical(here, there)
    assert executor.jobs == 3, "expected several cells in a piece"
    q = np.random.default_rng(1).uniform(*arm.limits.T, (volume.DRAWN_AT_ONCE + 1, 6))
    for method in ("monte-carlo", "zonotope"):
        rngs = [np.random.default_rng(2) for _ in range(2)]
        one, other = (
            accuracy_volume(model, q, method=method, rng=rng, draws=100, workers=w)
            for rng, w in zip(rngs, (1, executor), strict=True)
        )
        np.testing.assert_array_equal(one.volume, other.volume)
        np.testing.assert_array_equal(one.covariance, other.covariance)
    assert executor.submit(sum, [1, 2]).result() == 3, "was shut down"
