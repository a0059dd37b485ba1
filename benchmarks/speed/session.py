# SPDX-License-Identifier: BSD-3-Clause
"""Overhead of an open session in addition to the flights, and of a warm `rockfall.run`.

    python -m benchmarks.speed.session [--repeat 30] [--boulders 1000]

`cases/vaujany` on one thread, without maps and with the nine maps of the case: CPU milliseconds of
this thread, minimum and median of `--repeat` repetitions. Flights are the calls of the kernel; a
run is `for batch in session.run()` minus its flights, without and with a final Dataset; a change
moves the release, or a line; statistics are for one and for two quantities at both lines. Then the
time until a run on another thread ends after it is cancelled (wall clock: on an idle machine).
"""

from __future__ import annotations

import argparse
import statistics
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import rockfall
from benchmarks.machine import VAUJANY, machine

QUANTITIES = {"one quantity": ["energy_total"], "two": ["energy_total", "passing_height"]}


def measured(work: Callable[[], Any], repeat: int) -> list[float]:
    """CPU milliseconds of this thread for each repetition of some work."""
    found = []
    for _ in range(repeat):
        begun = time.thread_time()
        work()
        found.append(1e3 * (time.thread_time() - begun))
    return found


def show(what: str, found: list[float]) -> None:
    print(f"{what:<44}{min(found):9.2f}{statistics.median(found):9.2f}")


def last_batch(session: rockfall.Session, **how: Any) -> rockfall.Batch:
    """The last batch of a run."""
    *_, batch = session.run(**how)
    return batch


def beside_flights(session: rockfall.Session, repeat: int, with_dataset: bool) -> list[float]:
    """CPU time [ms] outside the kernel in each of `repeat` runs."""
    found = []
    for _ in range(repeat):
        begun = time.thread_time()
        batch = last_batch(session)
        if with_dataset:
            batch.dataset()
        found.append(1e3 * (time.thread_time() - begun - batch.cpu_seconds))
    return found


def measure(case: rockfall.Case, repeat: int) -> None:
    """Print the times for a case."""
    with rockfall.open(case) as session:
        batch = last_batch(session)
        show("flights", [1e3 * last_batch(session).cpu_seconds for _ in range(repeat)])
        show("run beside its flights", beside_flights(session, repeat, False))
        show("run with its Dataset, beside its flights", beside_flights(session, repeat, True))
        places = iter(np.linspace(95.0, 105.0, 2 * repeat + 9))
        show("change of the release", measured(
            lambda: session.change(release={"x": [next(places)]}), repeat))  # fmt: skip
        lines = [{"name": "L", "x": [0.0, 200.0], "y": [next(places)] * 2} for _ in range(repeat)]
        show("change of a line", measured(lambda: session.change(line=[lines.pop()]), repeat))
        session.change(line=case.line)
        for name, quantities in QUANTITIES.items():
            show(f"statistics of {name}", measured(
                lambda chosen=quantities: batch.line_statistics(quantities=chosen), repeat
            ))  # fmt: skip
        show("statistics of all", measured(batch.line_statistics, repeat))
    found = []
    for _ in range(repeat):
        begun = time.thread_time()
        result = rockfall.run(case)
        found.append(1e3 * (time.thread_time() - begun - result.attrs["cpu_seconds"]))
    show("rockfall.run beside its flights", found)


def answers(case: rockfall.Case, repeat: int) -> list[float]:
    """Wall milliseconds from cancelling a run on another thread to its end."""
    found = []
    with rockfall.open(case) as session:
        for k in range(repeat):
            cancel, ended = threading.Event(), []

            def work(cancel: threading.Event = cancel, ended: list = ended) -> None:
                for _ in session.run(10**6, cancel=cancel):
                    pass
                ended.append(time.perf_counter())

            runner = threading.Thread(target=work)
            runner.start()
            time.sleep(0.1 + 0.003 * k)
            begun = time.perf_counter()
            cancel.set()
            runner.join()
            found.append(1e3 * (ended[0] - begun))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeat", type=int, default=30)
    parser.add_argument("--boulders", type=int, default=1000)
    given = parser.parse_args()
    case = rockfall.read_case(VAUJANY)
    maps = case.output["maps"]
    print(machine())
    for name, chosen in ("no maps", None), (f"{len(maps)} maps", maps):
        print(f"\n{given.boulders} boulders, {name:<28} least   median  ms")
        measure(
            case.replace(
                case={"boulders": given.boulders, "threads": 1},
                output={"maps": chosen, "rebounds": False, "trajectories": 0},
            ),
            given.repeat,
        )
    found = answers(case.replace(output={"trajectories": 0}), given.repeat)
    print(
        f"\ncancel answered after: median {statistics.median(found):.0f} ms, most {max(found):.0f}"
    )


if __name__ == "__main__":
    main()
