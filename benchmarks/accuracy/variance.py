# SPDX-License-Identifier: BSD-3-Clause
"""Do Sobol' samples know more than as many random ones? Error against boulders and CPU time.

    python -m benchmarks.accuracy.variance [--boulders 262144] [--samples 64]

`cases/vaujany`, by its own volumes and by wide ones (lognormal, deviation = mean), at lines ever
farther below the release. A sample is the boulders of one of many sources at one place; of each
size there are at least `--samples`, and `--boulders` boulders. `volume` spreads only the volumes
evenly, `sobol` (&case sampling) also the words of the first rebound. Errors are root mean squares
about the number of a random run of its own, at least 2**20 boulders, as shares of that number.
"""

import argparse

import numpy as np
import xarray as xr

import rockfall
from benchmarks.machine import NOTHING, VAUJANY, machine
from rockfall.analysis.line_statistics import line_numbers
from rockfall.scene import scene

LINES = {"3.5 m": 584.0, "7.5 m": 580.0, "17.5 m": 570.0, "EL1": 441.72, "EL2": 402.32}
WIDE = {"volume": "lognormal", "volume_mean": 0.8, "volume_std": 0.8}
METHODS = {"random": 0, "volume": 1, "sobol": 13}  # dimensions of the Sobol' points
SIZES = 2 ** np.arange(6, 15, 2)
INTERVALS = 1024  # size of the samples whose intervals are looked at
AT_ONCE = 2**16  # boulders of a run
STATISTICS = [
    ("speed", "fraction"),
    *((quantity, name) for quantity in ("speed", "energy_translational")
      for name in ("mean", "std", "q95")),
]  # fmt: skip


def run(case: rockfall.Case, method: str, size: int, total: int, seed: int = 0) -> list[xr.Dataset]:
    """Runs with `total` boulders in samples of `size`, from sources that all lie at one place."""
    scene.SAMPLINGS["sobol"] = METHODS[method]
    sampling = "random" if method == "random" else "sobol"
    release = {axis: case.release[axis] * (AT_ONCE // size) for axis in "xy"}
    return [
        rockfall.run(
            case.replace(
                case={"boulders": size, "seed": seed + k, "sampling": sampling}, release=release
            )
        )
        for k in range(total // AT_ONCE)
    ]


def estimates(results: list[xr.Dataset], size: int) -> np.ndarray:
    """The numbers of each sample: (lines, statistics, samples)."""
    found = np.empty((len(LINES), len(STATISTICS), len(results) * AT_ONCE // size))
    for k in range(len(LINES)):
        for quantity in ("speed", "energy_translational"):
            parts = [result[f"line_{quantity}"].values[k].reshape(-1, size) for result in results]
            numbers = _numbers(np.concatenate(parts))
            for j, (of, name) in enumerate(STATISTICS):
                if of == quantity:
                    found[k, j] = numbers[name]
    return found


def _numbers(values: np.ndarray) -> dict[str, np.ndarray]:
    """As `line_statistics` has them, of each row; NaN: did not cross."""
    ordered = np.sort(values, axis=1)  # NaN last
    n = np.isfinite(ordered).sum(axis=1)
    low, part = np.divmod(0.95 * (n - 1), 1)
    ranks = np.stack([low, np.minimum(low + 1, n - 1)], axis=1).astype(int)
    below, above = np.take_along_axis(ordered, ranks, axis=1).T
    return {
        "fraction": n / values.shape[1],
        "mean": np.nanmean(ordered, axis=1),
        "std": np.nanstd(ordered, axis=1, ddof=1),
        "q95": below + part * (above - below),
    }


def intervals_hold(results: list[xr.Dataset], size: int, truth: np.ndarray) -> np.ndarray:
    """Share of the samples whose 95 % interval holds the truth: (lines, statistics)."""
    held, source = [], np.zeros(size, int)
    for result in results:
        for first in range(0, AT_ONCE, size):
            sample = result.isel(boulder=slice(first, first + size))
            for k in range(len(LINES)):
                for j, (quantity, name) in enumerate(STATISTICS):
                    row = line_numbers(sample, k, quantity, source)
                    held.append(row[f"{name}_low"] <= truth[k, j] <= row[f"{name}_high"])
    return np.reshape(held, (-1, len(LINES), len(STATISTICS))).mean(axis=0)


def compare(case: rockfall.Case, boulders: int, samples: int) -> None:
    totals = np.maximum(max(boulders, AT_ONCE), samples * SIZES)
    reference = run(case, "random", AT_ONCE, max(2**20, boulders), seed=1000)
    truth = estimates(reference, AT_ONCE).mean(axis=-1)
    del reference
    alike = run(
        case, "random", AT_ONCE, int(totals.max())
    )  # random boulders make samples of any size
    rms = np.empty((len(METHODS), SIZES.size, *truth.shape))
    held, cpu = [], []
    for m, method in enumerate(METHODS):
        seconds = []
        for i, (size, total) in enumerate(zip(SIZES.tolist(), totals.tolist(), strict=True)):
            some = alike[: total // AT_ONCE]
            results = some if method == "random" else run(case, method, size, total)
            seconds += [result.attrs["cpu_seconds"] for result in results]
            error = estimates(results, size) - truth[..., None]
            rms[m, i] = np.sqrt((error**2).mean(axis=-1))
            if size == INTERVALS:
                held.append(intervals_hold(results[: 2**18 // AT_ONCE], size, truth))
        cpu.append(min(seconds) / AT_ONCE)
        print(f"{method}: {1e6 * cpu[-1]:.2f} us of CPU a boulder", flush=True)
    for k, line in enumerate(LINES):
        table(line, truth[k], rms[:, :, k], totals // SIZES, [one[k] for one in held], cpu)


def table(line, truth, rms, samples, held, cpu) -> None:
    """Saved: of the variance, over all sizes. Gain: random over method, variance times CPU."""
    print(f"\n{line}, {truth[0]:.1%} of the boulders pass")
    print(f"{'':36}" + "".join(f"{size:>9}" for size in SIZES), end="")
    print(f"{'slope':>17}{'saved':>16}{'gain':>7}{'95 % hold':>11}")
    for j, (quantity, name) in enumerate(STATISTICS):
        if name == "fraction" and truth[0] > 0.99:
            continue
        for m, method in enumerate(METHODS):
            error = rms[m, :, j]
            row = f"{quantity if name != 'fraction' else '':21}{name:7}{method:8}"
            row += "".join(f"{e:9.3%}" for e in error / truth[j])
            row += f"{'{:.3f} +- {:.3f}'.format(*slope(error, samples)):>17}"
            ratio = (error / rms[0, :, j]) ** 2
            weight = samples / samples.sum()
            saved = 1 - (weight * ratio).sum()
            sure = np.sqrt((weight**2 * ratio**2 * 4 / samples).sum())
            gain = cpu[0] / cpu[m] / (1 - saved)
            row += f"{f'{saved:.1%} +- {sure:.1%}':>16}{gain:7.2f}" if m else f"{'':23}"
            print(f"{row}{held[m][j]:11.1%}")


def slope(error: np.ndarray, samples: np.ndarray) -> tuple[float, float]:
    """Of log error against log size, and its standard error."""
    weight = np.sqrt(2 * samples)  # of the logarithm of a root mean square
    (found, _), covariance = np.polyfit(np.log(SIZES), np.log(error), 1, w=weight, cov="unscaled")
    return found, np.sqrt(covariance[0, 0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=2**18)
    parser.add_argument("--samples", type=int, default=64)
    options = parser.parse_args()
    print(machine())
    case = rockfall.read_case(VAUJANY).replace(
        line=[{"name": name, "x": [1.25, 198.75], "y": [y, y]} for name, y in LINES.items()],
        output=NOTHING,
    )
    for title, boulder in {"its own volumes": {}, "wide volumes": WIDE}.items():
        print(f"\n== cases/vaujany, {title}")
        compare(case.replace(boulder=boulder), options.boulders, options.samples)


if __name__ == "__main__":
    main()
