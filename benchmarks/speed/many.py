# SPDX-License-Identifier: BSD-3-Clause
"""Boulders whose rows do not fit in memory: `&output kept`, on cases/vaujany without maps.

    python -m benchmarks.speed.many [--boulders 100000000] [--kept none] [--shards 16] [--threads 0]

Runs a tenth of the boulders, then all, and prints the peak memory of both (VmHWM), which must be
equal. Each run is killed once and resumed. Then the boulders are run as shards and merged: the
result must be bit-identical to the unsharded run. Statistics of a tenth of the boulders, at most a
million, are compared with a run that keeps all rows.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine, run_child

ROCKFALL = [sys.executable, "-m", "rockfall"]
OWN = ("wall_seconds", "cpu_seconds", "threads", "history", "date_created")  # differ between runs
MB = 1e6


def run(folder: Path, kept: str, boulders: int, threads: int, output: str, *more: str) -> int:
    """Run some boulders; print the cost and return the peak memory [bytes]."""
    words = [*command(kept, boulders, threads, output), *more]
    begun = time.perf_counter()
    _, cpu, peak = run_child(*words, cwd=folder)
    wall = time.perf_counter() - begun
    size = (folder / output).stat().st_size
    said = f"{peak / MB:6.0f} MB, {cpu:7.1f} s of CPU, {wall:7.1f} s, file {size / MB:.1f} MB"
    print(f"{output:12} {boulders:>13,} boulders: {said}", flush=True)
    return peak


def command(kept: str, boulders: int, threads: int, output: str) -> list[str]:
    about = ["--boulders", boulders, "--threads", threads, "--quiet", "-o", output]
    return [*ROCKFALL, "run", f"{kept}.nml", *map(str, about)]


def kill_on_the_way(folder: Path, words: list[str], seconds: float) -> None:
    """Kill a run that saves every second, after `seconds`, but not before its first save."""
    process = subprocess.Popen([*words, "--checkpoint", "1"], cwd=folder)
    time.sleep(seconds)
    checkpoint = folder / f"{words[-1]}.checkpoint"
    while process.poll() is None and not checkpoint.exists():
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    print(f"killed after {seconds:.0f} s: {checkpoint.stat().st_size / MB:.1f} MB are kept")


def same(one: Path, other: Path) -> bool:
    """Return True if two results are bit-identical, except texts and the attributes in OWN."""
    a, b = rockfall.read_result(one), rockfall.read_result(other)
    found = {*a.variables} == {*b.variables}
    for name in a.variables:
        x, y = a[name].values, b[name].values
        found &= x.dtype.kind == "O" or (x.dtype == y.dtype and x.tobytes() == y.tobytes())
    attrs = [{k: v for k, v in r.attrs.items() if k not in OWN} for r in (a, b)]
    return found and str(attrs[0]) == str(attrs[1])


def compare(folder: Path, kept: str, boulders: int, threads: int) -> None:
    """Print the maximum relative differences of line statistics between a run with `kept` rows and
    a run with all rows."""
    for name in ("all", kept):
        run(folder, name, boulders, threads, f"{name}_few.nc")
    results = [rockfall.read_result(folder / f"{name}_few.nc") for name in ("all", kept)]
    rows, counts = map(rockfall.line_statistics, results)
    print("largest relative difference from the statistics of all rows, with its line and quantity")
    for name in rows.columns[2:]:
        apart = (counts[name] / rows[name] - 1).abs().fillna(0.0)
        worst = apart.idxmax()
        where = f"{rows['line'][worst]} {rows['quantity'][worst]}"
        print(f"  {name:14} {apart[worst]:.1e}  {where}")
    levels = [rockfall.return_levels(result) for result in results]
    print(f"  return levels  {'equal' if levels[0].equals(levels[1]) else 'differ'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--boulders", type=int, default=10**8)
    parser.add_argument("--kept", default="none")
    parser.add_argument("--shards", type=int, default=16)
    parser.add_argument("--threads", type=int, default=0)
    given = parser.parse_args()
    print(machine())
    with tempfile.TemporaryDirectory() as name:
        folder, n, threads = Path(name), given.boulders, given.threads
        case = rockfall.read_case(VAUJANY)
        files = {"dem": VAUJANY.parent / "dem.tif"}
        surface = {key: VAUJANY.parent / case.surface[key] for key in ("zones", "table")}
        for kept in ("all", given.kept):
            value = int(kept) if kept.isdecimal() else kept
            one = case.replace(terrain=files, surface=surface, output=NOTHING | {"kept": value})
            (folder / f"{kept}.nml").write_text(one.text())
        begun = time.perf_counter()
        few = run(folder, given.kept, n // 10, threads, "tenth.nc")
        seconds = 3 * (time.perf_counter() - begun)
        kill_on_the_way(folder, command(given.kept, n, threads, "whole.nc"), seconds)
        peak = run(folder, given.kept, n, threads, "whole.nc", "--resume")
        print(f"peak memory: {peak / few:.2f} times that of a tenth of the boulders")
        parts = [f"part{k}.nc" for k in range(1, given.shards + 1)]
        for k, part in enumerate(parts, start=1):
            run(folder, given.kept, n, threads, part, "--shard", f"{k}/{given.shards}")
        _, _, peak = run_child(*ROCKFALL, "merge", *parts, "-o", "merged.nc", cwd=folder)
        bits = "the same bits" if same(folder / "whole.nc", folder / "merged.nc") else "DIFFERS"
        print(f"merge of {given.shards} shards: {peak / MB:.0f} MB; {bits} as in one piece")
        compare(folder, given.kept, min(10**6, n // 10), threads)


if __name__ == "__main__":
    main()
