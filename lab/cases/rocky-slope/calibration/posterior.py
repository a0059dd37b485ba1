# SPDX-License-Identifier: BSD-3-Clause
"""Inference of the laboratory's parameters from the paper's slope, by emcee.

    python posterior.py WORK --prior 512      # site statistics over the prior: prior.csv
    python posterior.py WORK --wave 8         # next training settings, into settings.csv
    python posterior.py WORK --steps 100      # the chain; continues an interrupted one
    python posterior.py WORK --draws 24       # states of the posterior: posterior.csv

A state of the chain consists of a laboratory setting, the recorded boulder state that counts as the
rebound, and the unknown properties of the slope. Its likelihood combines the published statistics
at EL1 by methods A and B, the published rebounds, and the rule that larger boulders are not less
mobile on the same ground. Boulders have the same seeds in all states. The standard error of the
modelled site is half the tolerance of the scorecard (for energies, the full tolerance). A and B, on
the same slopes, count as one observation, all others as independent. The variance of the emulator
is added.
"""

from __future__ import annotations

import argparse
import hashlib
from functools import cache
from multiprocessing import Pool
from pathlib import Path

import emcee
import numpy as np
import pandas as pd
import xarray as xr
from design import HERE, PARAMETERS, add_settings, physical
from emulator import Emulator
from scipy.special import log_ndtr
from scipy.stats import qmc

from rockfall.analysis.planes.plane_bounce import growth, set_rebound
from rockfall.scene.rebounds.sets import Sets
from rockfall_lab.scorecard.site import Site, at_lines
from rockfall_lab.scorecard.vaujany_slope import Talus
from rockfall_lab.spheres.experiment import STATES

VAUJANY = HERE.parents[1] / "vaujany"
#: Further unknown parameters, with the ends of their ranges.
NUISANCES = {
    "state": (0, len(STATES)), "relief": (0.2, 0.5), "channel": (1.0, 2.0), "roads": (0.3, 1.0),
}  # fmt: skip
TERRAINS = 1, 2  # seeds of the relief
BOULDERS = 400
WALKERS = 32
#: Values published for EL1 by A and B, and the relative standard deviation of a stand-in slope.
PRINTED = {
    "speed": ((11.5, 12.7), 0.05), "speed_std": ((4.2, 4.3), 0.125),
    "passing_height": ((1.2, 1.4), 0.05), "passing_height_std": ((0.9, 1.0), 0.125),
    "energy_translational": ((175, 213), 0.10), "energy_translational_std": ((126, 152), 0.25),
}  # fmt: skip
REBOUNDS = {"rt": (0.7, 0.025), "tangential": (0.93, 0.015)}  # values and deviations
#: One-sided constraints: limit, sign of the allowed side, softness.
BOUNDS = {"rn_5_15": (1.0, 1, 0.05), "stop_short": (0.04, -1, 0.01)}
BOUNDS |= {f"gain_{k}": (0.0, 1, 0.01) for k in (2, 3, 4, 5)}
SLOPE = 36.0  # plane on which ratios are compared [degrees]
NAMES = (*PARAMETERS, *NUISANCES)


@cache
def emulators() -> dict[str, Emulator]:
    table = xr.load_dataset(HERE / "design.nc")
    return {state: Emulator(table, state) for state in STATES}


@cache
def site() -> Site:
    return Site(VAUJANY, BOULDERS, trajectories=100)


def nuisances(u: np.ndarray) -> dict[str, float]:
    """Nuisance parameters of a chain state, in their units."""
    ends = zip(NUISANCES.items(), u[len(PARAMETERS) :], strict=True)
    return {name: low + one * (high - low) for (name, (low, high)), one in ends}


def state_of(u: np.ndarray) -> str:
    """Name of the recorded boulder state that a chain state uses."""
    return list(STATES)[min(int(nuisances(u)["state"]), len(STATES) - 1)]


def sets_of(u: np.ndarray, z: np.ndarray | None = None) -> Sets:
    """Impact sets of a chain state; `z` as for the emulator."""
    return Sets("", *emulators()[state_of(u)].predict(u[: len(PARAMETERS)], z))


def slopes(u: np.ndarray) -> list[Talus]:
    about = nuisances(u)
    return [Talus(seed, about["relief"], about["channel"], about["roads"]) for seed in TERRAINS]


def numbers(sets: Sets, u: np.ndarray) -> dict[str, float]:
    """Site statistics averaged over the slopes, and for each ratio the log growth of a bounce
    relative to the next smaller ratio."""
    each = [
        site().numbers(sets, seed=one.seed, talus=one, threads=1, reading="diameter")
        for one in slopes(u)
    ]
    found = {name: float(np.mean([one[name] for one in each])) for name in each[0]}
    grown = [
        growth(set_rebound(*one), SLOPE, 200).mean
        for one in zip(sets.mean, sets.covariance, strict=True)
    ]
    return found | {f"gain_{k + 2}": one for k, one in enumerate(np.diff(grown))}


def log_likelihood(found: dict[str, float], unknown: dict[str, float]) -> float:
    """Log-likelihood of a site's statistics; `unknown` are the emulator's standard deviations."""
    total = 0.0
    for name, (values, share) in PRINTED.items():
        for method, value in zip("AB", values, strict=True):
            key = f"{method}_EL1_{name}"
            deviation = np.hypot(share * value, unknown.get(key, 0.0))
            total -= 0.25 * ((found[key] - value) / deviation) ** 2  # half the weight per method
    for key, (value, error) in REBOUNDS.items():
        total -= 0.5 * ((found[key] - value) / np.hypot(error, unknown.get(key, 0.0))) ** 2
    for key, (bound, sign, error) in BOUNDS.items():
        total += log_ndtr(sign * (found[key] - bound) / np.hypot(error, unknown.get(key, 0.0)))
    return float(total) if np.isfinite(total) else -np.inf  # -inf if too few boulders passed


class Likelihood:
    """Likelihood of a chain state, with the emulator's errors, for a pool of processes."""

    def __init__(self, unknown: dict[str, float]) -> None:
        self.unknown = unknown

    def __call__(self, u: np.ndarray) -> float:
        if not ((u > 0) & (u < 1)).all():
            return -np.inf
        return log_likelihood(numbers(sets_of(u), u), self.unknown)


def over_prior(u: np.ndarray) -> dict[str, float]:
    """Statistics of a chain state, with the default and other readings of the paper."""
    sets = sets_of(u)
    found = numbers(sets, u)
    radius, aspect = dict(found), dict(found)
    for one in slopes(u)[:1]:
        told = {"seed": one.seed, "talus": one, "threads": 1}
        radius |= at_lines("A", site().run(sets, reading="radius", methods="A", **told)["A"])
        turned = site().run(sets, reading="diameter", turning="to_aspect", **told)
        for method, result in turned.items():
            aspect |= at_lines(method, result)
    return {
        **dict(zip(NAMES, u, strict=True)), **found,
        "radius_A_EL1_speed": radius["A_EL1_speed"],
        "aspect_B_EL1_speed": aspect["B_EL1_speed"],
        "without_emulator_error": log_likelihood(found, {}),
        "without_radius": log_likelihood(radius, {}),
        "without_to_aspect": log_likelihood(aspect, {}),
    }  # fmt: skip


def prior(count: int, pool) -> None:
    """Write the statistics of the first states of a Sobol sequence to prior.csv."""
    u = qmc.Sobol(len(NAMES), rng=np.random.default_rng(5)).random(count)
    rows = pool.map(over_prior, u, chunksize=4)
    pd.DataFrame(rows).to_csv(HERE / "prior.csv", index=False, float_format="%.5g")


def best_of_prior(count: int) -> np.ndarray:
    table = pd.read_csv(HERE / "prior.csv").sort_values("without_emulator_error", ascending=False)
    return table[list(NAMES)].values[:count]


def wave(count: int) -> None:
    """Add likely states of the prior that are far from each other to the settings."""
    unit = best_of_prior(6 * count)[:, : len(PARAMETERS)]
    chosen = [0]
    while len(chosen) < count:
        apart = ((unit[:, None] - unit[chosen]) ** 2).sum(2).min(1)
        chosen.append(int(np.argmax(apart)))
    add_settings(physical(unit[chosen]))


def emulator_error(numbered: tuple[np.ndarray, np.ndarray]) -> dict[str, float]:
    u, z = numbered
    return numbers(sets_of(u, z), u)


def run(work: Path, steps: int, pool) -> None:
    """Continue the chain up to a number of steps."""
    start, errors = best_of_prior(WALKERS), work / f"unknown-{learnt_from()}.csv"
    if not errors.exists():
        z = np.random.default_rng(7).standard_normal((24, 16))
        found = pd.DataFrame(pool.map(emulator_error, [(start[0], one) for one in z]))
        found.std().to_csv(errors, header=False)
    unknown = pd.read_csv(errors, index_col=0, header=None)[1].to_dict()
    backend = emcee.backends.HDFBackend(work / f"chain-{learnt_from()}.h5")
    sampler = emcee.EnsembleSampler(
        WALKERS, len(NAMES), Likelihood(unknown), pool=pool, backend=backend,
        moves=[(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)],
    )  # fmt: skip
    done = backend.iteration if backend.initialized else 0
    seeded = np.random.RandomState(13).get_state()
    first = backend.get_last_sample() if done else emcee.State(start, random_state=seeded)
    for state in sampler.sample(first, iterations=max(0, steps - done)):
        likely = np.sort(state.log_prob)
        print(
            backend.iteration, "log likelihood", likely[[0, WALKERS // 2, -1]].round(1), flush=True
        )


def learnt_from() -> str:
    """Identity of the chain: with another emulator or prior, a new chain is started."""
    digest = hashlib.sha256()
    for name in "design.nc", "prior.csv", "emulator.py":
        digest.update((HERE / name).read_bytes())
    return digest.hexdigest()[:8]


def sample(work: Path) -> np.ndarray:
    """States in the second half of the chain."""
    backend = emcee.backends.HDFBackend(work / f"chain-{learnt_from()}.h5", read_only=True)
    times = backend.get_autocorr_time(discard=backend.iteration // 2, tol=0)
    print(f"{backend.iteration} steps; autocorrelation time {times.min():.0f} to {times.max():.0f}")
    return backend.get_chain(discard=backend.iteration // 2, flat=True)


def centre(u: np.ndarray) -> np.ndarray:
    """State nearest to the mean of all states, ignoring the boulder state."""
    reals = np.array(NAMES) != "state"
    off = ((u - u.mean(0)) / u.std(0))[:, reals]
    return u[(off**2).sum(1).argmin()]


def likeliest(u: np.ndarray, pool) -> np.ndarray:
    """State `u` with the boulder state that makes it most likely."""
    each = np.tile(u, (len(STATES), 1))
    each[:, NAMES.index("state")] = (np.arange(len(STATES)) + 0.5) / len(STATES)
    values = pool.map(Likelihood({}), each)
    print("log likelihood at the centre:", dict(zip(STATES, np.round(values, 1), strict=True)))
    return each[int(np.argmax(values))]


def in_units(u: np.ndarray) -> pd.DataFrame:
    """Chain states in the units of the laboratory case, and the selected boulder state."""
    table = pd.DataFrame(physical(u[:, : len(PARAMETERS)]), columns=list(PARAMETERS))
    for one, (name, (low, high)) in zip(u[:, len(PARAMETERS) :].T, NUISANCES.items(), strict=True):
        table[name] = low + one * (high - low)
    table["counts"] = [state_of(one) for one in u]
    return table.drop(columns="state")


def draws(work: Path, count: int, pool) -> None:
    """Write states of the posterior to posterior.csv (first the state nearest to the centre, then
    equally likely states, at the ends of walkers), and its description to posterior.md."""
    u = sample(work)
    ends = u[-WALKERS:][np.random.default_rng(11).permutation(WALKERS)[:count]]
    picked = np.vstack([likeliest(centre(u), pool), ends])
    found = pd.DataFrame(pool.map(over_prior, picked)).drop(columns=list(NAMES))
    table = pd.concat([in_units(picked), found], axis=1)
    table.to_csv(HERE / "posterior.csv", index=False, float_format="%.6g")
    whole = in_units(u)
    (HERE / "posterior.md").write_text("\n".join(summary(whole, found)) + "\n", encoding="utf-8")


def quantiles(table: pd.DataFrame) -> list[str]:
    rows = [
        f"| {name} | " + " | ".join(f"{q:.3g}" for q in one.quantile([0.05, 0.5, 0.95])) + " |"
        for name, one in table.items()
    ]
    return ["| | 5 % | median | 95 % |", "| --- | --: | --: | --: |", *rows]


def summary(whole: pd.DataFrame, found: pd.DataFrame) -> list[str]:
    """Description of the ridge: quantiles, correlations, and the parameters of the draws."""
    reals = whole.drop(columns="counts")
    text = ["# The posterior", "", "Written by posterior.py. The parameters, over the chain:", ""]
    text += [*quantiles(reals), "", f"The numbers of {len(found) - 1} draws:", ""]
    text += quantiles(found[1:])
    shares = whole["counts"].value_counts(normalize=True)
    text += ["", "State that counts: " + ", ".join(f"{k} {v:.0%}" for k, v in shares.items()), ""]
    together = reals.corr(method="spearman").stack()
    strong = together[[a < b for a, b in together.index]].sort_values(key=abs, ascending=False)
    text += [
        "Rank correlations: " + ", ".join(f"{a}, {b} {r:+.2f}" for (a, b), r in strong[:8].items())
    ]
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    for name in "prior", "wave", "steps", "draws":
        parser.add_argument(f"--{name}", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    told = parser.parse_args()
    told.work.mkdir(parents=True, exist_ok=True)
    if told.wave:
        wave(told.wave)
    if told.prior or told.steps or told.draws:
        emulators()
        with Pool(told.processes) as pool:
            if told.prior:
                prior(told.prior, pool)
            if told.steps:
                run(told.work, told.steps, pool)
            if told.draws:
                draws(told.work, told.draws, pool)


if __name__ == "__main__":
    main()
