# SPDX-License-Identifier: BSD-3-Clause
"""Runs on a Dask cluster: bit-identical results, also if a worker dies."""

import os
import signal
from contextlib import contextmanager

import pytest

import rockfall
from made import refused
from rockfall.cli import main
from rockfall.scene.read import read_scene
from rockfall.simulation import dask as cluster
from rockfall.simulation.dask import run_on_cluster

distributed = pytest.importorskip("distributed")


@contextmanager
def cluster_of_two(**how):
    """Yield the address of a cluster with two workers, and its client."""
    about = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, **how}
    with (
        distributed.LocalCluster(**about) as local,
        distributed.Client(local, set_as_default=False) as client,
    ):
        yield local.scheduler_address, client


@pytest.fixture(scope="module")
def workers():
    """Workers in this process, where libraries are loaded already; data reach them through a
    socket."""
    with cluster_of_two(processes=False, protocol="tcp") as cluster:
        yield cluster


@pytest.fixture
def processes():
    with cluster_of_two(processes=True) as cluster:
        yield cluster


def scene_of(path, boulders):
    return read_scene(rockfall.read_case(path).replace(case={"boulders": boulders}))


def test_the_result_is_that_of_a_run_here(workers, few_boulders):
    scene = scene_of(few_boulders, 500)
    found = run_on_cluster(scene, workers[0]).dataset()
    here = rockfall.run(scene.case)
    assert found.equals(here)
    for name in ("case", "boulder_last", "boulders_requested", "complete", "input_checksums"):
        assert found.attrs[name] == here.attrs[name]


@pytest.mark.all  # takes seconds in the library's processes
def test_a_worker_that_dies_in_the_middle_is_done_without(processes, few_boulders, monkeypatch):
    scene = scene_of(few_boulders, 5000)
    address, client = processes
    killed, add = [], cluster.Joined.add

    def add_and_kill(joined, part):
        add(joined, part)
        if not killed:  # one of the two workers, which now runs another part
            pid = min(client.run(os.getpid).values())
            os.kill(pid, signal.SIGKILL)
            killed.append(pid)

    monkeypatch.setattr(cluster.Joined, "add", add_and_kill)
    found = run_on_cluster(scene, address, parts=40).dataset()
    assert len(killed) == 1
    assert found.equals(rockfall.run(scene.case))


@pytest.mark.all
def test_the_command(few_boulders, tmp_path, monkeypatch, workers):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "case.nml", "--quiet", "--dask", workers[0], "-o", "dask.nc"]) == 0
    assert main(["run", "case.nml", "--quiet", "-o", "here.nc"]) == 0
    found, here = (rockfall.read_result(f"{name}.nc") for name in ("dask", "here"))
    assert found.equals(here)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["case.nml", "dask.nc", "here.nc"]


def test_one_boulder_needs_no_cluster(few_boulders, workers):
    scene = scene_of(few_boulders, 1)
    assert run_on_cluster(scene, workers[0]).dataset().equals(rockfall.run(scene.case))


@pytest.mark.parametrize("where", ["local:0", "local:x"])
def test_wrong_places_are_refused(few_boulders, where):
    with refused(f"--dask {where}: must be local:N with N >= 1, or an address"):
        run_on_cluster(scene_of(few_boulders, 1), where)


@pytest.mark.all
def test_where_nobody_answers(few_boulders, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "SECONDS", 1)
    for where in ("tcp://127.0.0.1:9", "nonsense://x"):
        assert main(["run", "case.nml", "--dask", where]) == 2
        err = capsys.readouterr().err
        assert err.startswith(f"rockfall: --dask {where}: no scheduler responds")
        assert err.count("\n") == 1
    assert main(["run", "case.nml", "--dask", "local:2", "--resume"]) == 2
    assert main(["run", "case.nml", "--dask", "local:2", "--until", "share@EL1<5%"]) == 2
    assert not list(tmp_path.glob("*.nc"))


@pytest.mark.all
def test_processes_of_this_machine_take_nothing_from_strangers(few_boulders):
    """Other users of the machine can reach the port, but have no credentials."""
    pytest.importorskip("cryptography")
    with cluster._client("local:1") as client:
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        assert client.submit(sum, (1, 2)).result(timeout=600) == 3
        (worker,) = client.scheduler_info()["workers"]
        strange = distributed.Security.temporary()
        for place in (address, worker):
            for way, key in ((place, strange), (place.replace("tls:", "tcp:"), None)):
                with pytest.raises(OSError):
                    distributed.Client(way, timeout=2, security=key, set_as_default=False)
