# SPDX-License-Identifier: BSD-3-Clause
"""Runs on a Dask cluster: workers simulate parts, which are merged as they arrive."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rockfall.case import Case
from rockfall.errors import OUR_FAULT, RockfallError, need
from rockfall.interrupts import interrupts
from rockfall.result.dataset import provenance
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.simulation.parts.merge import Joined
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import simulate

if TYPE_CHECKING:
    from rockfall.result.contents import Contents

PARTS = 16  # parts per thread; workers then finish together, and a lost part costs little
SECONDS = 20  # timeout for connecting to a scheduler
WINDOWS = threading.Lock()  # lock for the terrain windows on this worker


def run_on_cluster(
    scene: Scene, where: str, *, parts: int | None = None, progress: bool = False
) -> Contents:
    """Run a scene on a Dask cluster at an address, or on `local:N` processes of this machine.

    Each worker reads the rasters once; the files of the case must have the same paths on all
    workers. If a worker fails, another repeats its part. The result is bit-identical to that of
    `simulate`.
    """
    need("a Dask cluster needs", "cluster", "distributed")
    from distributed import as_completed

    case = scene.case.replace(case={"threads": 1})  # each worker thread runs one part
    case.folder = Path(case.folder).absolute()
    with interrupts() as interrupted, _client(where) as client:
        memory = 2 * scene.windows.bytes if scene.windows else None  # workers halve it for a window
        n = parts or PARTS * max(1, sum(client.nthreads().values()))
        n = max(2, min(n, scene.boulders))
        if scene.boulders < 2:
            return simulate(scene)
        parts = range(1, n + 1)
        futures = [client.submit(_part, case, memory, k, n, pure=False, retries=2) for k in parts]
        joined = Joined()
        with progress_bar(scene.boulders, shown=progress) as advance:
            for future in as_completed(futures, loop=client.loop):
                part = _result(future)
                if interrupted():
                    raise KeyboardInterrupt
                joined.add(part)
                advance(int(part.attrs["boulder_last"]) - int(part.attrs["boulder_first"]) + 1)
                future.release()
    result = joined.result()
    result.attrs |= {"case": scene.case.text(), **provenance(scene)}
    return result


@contextmanager
def _client(where: str) -> Iterator[Any]:
    """Client for the cluster at an address, or for a local cluster that ends with the block.
    Refuses other addresses, and raises a RockfallError if none responds."""
    from distributed import Client, LocalCluster
    from distributed.security import Security

    if not where.startswith("local:"):
        try:
            client = Client(where, timeout=SECONDS, **_straight(where))
        except (OSError, ValueError) as error:
            raise RockfallError(f"--dask {where}: no scheduler responds: {error}") from error
        with client:
            yield client
        return
    number = where.removeprefix("local:")
    if not number.isdecimal() or int(number) < 1:
        raise RockfallError(f"--dask {where}: must be local:N with N >= 1, or an address")
    need("local processes of Dask need", "cluster", "cryptography")
    attrs = {"n_workers": int(number), "threads_per_worker": 1, "dashboard_address": None}
    # Without credentials, other users of this machine could send code to the workers.
    with (
        LocalCluster(**attrs, processes=True, security=Security.temporary()) as cluster,
        Client(cluster, **_straight(cluster.scheduler_address)) as client,
    ):
        yield client


def _straight(address: str) -> dict[str, Any]:
    """Options for direct transfer from local workers; other workers may be unreachable."""
    here = re.match(r"(\w+://)?(127\.|localhost)", address) is not None
    return {"set_as_default": False, "direct_to_workers": here}


def _result(future: Any) -> Contents:
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker as error:
        raise RockfallError(f"workers failed repeatedly: {error}", code=OUR_FAULT) from error


def _part(case: Case, memory: float | None, which: int, parts: int) -> Contents:
    """Simulate a part on a worker. Only one thread at a time uses the windows, because they
    move."""
    scene = _scene(case, memory)
    with WINDOWS if scene.windows else nullcontext():
        return simulate(scene, shard=(which, parts))


@lru_cache(maxsize=1)
def _scene(case: Case, memory: float | None) -> Scene:
    """Scene of a case, read once by each worker."""
    return read_scene(case, memory=memory)
