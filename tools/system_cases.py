# SPDX-License-Identifier: BSD-3-Clause
"""Small cases of every kind, whose results must be bit-identical on every system.

usage: system_cases.py make FOLDER      FOLDER/*/trial of NAME.nml, of the shipped cases
       system_cases.py run FOLDER OUT   OUT/NAME.nc for each, by the rockfall of this Python
       system_cases.py prepare FOLDER READY        READY/NAME/case.nml for rockfall-batch
       system_cases.py batch READY OUT PROGRAM...  OUT/NAME.nc for each, by this rockfall-batch
       system_cases.py compare OUT OUT  differences between two such folders, by variable
"""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from rockfall._core import rockfall_f2py as _core

import rockfall
from rockfall.cli import main as rockfall_main
from rockfall.result import variables
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene

ROOT = Path(__file__).parents[1]
#: Case folders whose inputs are all shipped or made.
FOLDERS = "vaujany", "vaujany-forest", "forested-slope", "protected-road", "settlement", "plane"


class Trial(NamedTuple):
    """Trial: a file in `cases`, its changes, and arguments of `rockfall run`."""

    case: str
    groups: dict[str, Any] = {}
    words: tuple[str, ...] = ()
    boulders: int | None = 200


def of_vaujany(*words: str, **groups: Any) -> Trial:
    return Trial("vaujany/case.nml", groups, words)


def with_table(table: str, shape: str = "compact") -> Trial:
    impact = {"form": "table", "table": table}
    return of_vaujany(impact=impact, boulder={"block_shape": shape})


SPREAD = {"volume": "lognormal", "volume_mean": 0.8, "volume_std": 0.5}
BROKEN = {"release_fall": 8.0, "max_fragments": 20}
DECISION = "tutorial/decision.nml"
FULL_MAPS = {"maps": list(variables.MAP), "min_passages": 3, "trajectories": 20}
TRIALS = {
    "method B": of_vaujany("--threads", "2"),
    "method A": Trial("vaujany/case_A.nml"),
    "ratio between": of_vaujany(impact={"ratio": "between"}),
    "turned to the aspect": of_vaujany(impact={"turning": "to_aspect"}),
    "turned as in the laboratory": of_vaujany(impact={"turning": "lab"}),
    "every map": of_vaujany(output=FULL_MAPS, boulder=SPREAD),
    "table talus": with_table("talus"),
    "table meadow, platy": with_table("meadow", "platy"),
    "table rocky-slope": with_table("rocky-slope"),
    **{
        f"ground {name}": of_vaujany(surface={"ground": name}, impact={"impact_limit": 3000})
        for name in ("soil_4", "pfeiffer_soil", "rock_ledge", "bourrier_hungr")
    },
    "pareto": of_vaujany(
        boulder={
            "volume": "pareto",
            "volume_min": 0.1,
            "volume_max": 20.0,
            "volume_exponent": 0.6,
            "volume_mean": None,
            "volume_std": None,
        }
    ),
    "broken at release": of_vaujany(breakage={"at": "release", **BROKEN}),
    "broken": of_vaujany(breakage={"at": "both", **BROKEN}),
    "thrown": of_vaujany(release={"velocity": [2.0, -4.0, 1.5]}, flight={"gravity": 9.78}),
    "balance": of_vaujany(output={"energy_balance": True, "kept": 20}),
    "a sum": of_vaujany(output={"kept": "none"}),
    "until": of_vaujany("--until", "speed.mean@EL1<5%", "--cap", "3000"),
    "in windows": of_vaujany("--memory", "60kB"),
    "letters": of_vaujany(case={"title": "Straße 'über' den Hang"}),
    "bare forest slope": Trial("vaujany-forest/bare.nml", boulders=40),
    "uniform forest": Trial("vaujany-forest/forest.nml", boulders=40),
    "forest and net": Trial("forested-slope/forest-and-net.nml", boulders=25),
    "forest maps": Trial("forested-slope/forest.nml", {"output": FULL_MAPS}, boulders=25),
    "road": Trial("protected-road/road.nml", boulders=25),
    "net": Trial("protected-road/net.nml", boulders=25),
    "net and table": Trial("protected-road/net.nml", {"impact": {"form": "table"}}, boulders=25),
    "dam": Trial("protected-road/dam.nml", boulders=10),
    "steep cells": Trial("settlement/case.nml", boulders=2),
    "plane": Trial("plane/case.nml", boulders=1),
    "layers": Trial(DECISION, {"case": {"boulders_total": 800}}, ("--variant", "both"), None),
}
SHARDED, RESUMED, CARRIED = "in shards", "stopped and resumed", "lanes"
LANES = {"one by one": 0, "narrow": 1, "wide": 2, "masked": 3}  # modes of rockfall_scene_type


def make(folder: Path) -> None:
    """Copy the cases, make their layers, and write the trials next to them."""
    for name in FOLDERS:
        shutil.copytree(ROOT / "cases" / name, folder / name, dirs_exist_ok=True)
        if name not in ("vaujany", "plane"):  # these have their terrain
            script = folder / name / "make_terrain.py"
            subprocess.run([sys.executable, script, folder / name], check=True)
    (folder / "tutorial").mkdir(exist_ok=True)
    layers = ROOT / "cases/tutorial/make_layers.py"
    subprocess.run([sys.executable, layers, folder / "tutorial"], check=True)
    shutil.copy(ROOT / "cases/decision/decision.nml", folder / DECISION)
    for name, trial in TRIALS.items():
        case = rockfall.read_case(folder / trial.case)
        groups = dict(trial.groups)
        if trial.boulders:
            groups["case"] = {"boulders": trial.boulders} | groups.get("case", {})
        case_path(folder, name).write_text(case.replace(**groups).text(), "utf-8")
    many = rockfall.read_case(folder / "vaujany/case.nml").replace(case={"boulders": 30_000})
    (folder / "vaujany/many.nml").write_text(many.text(), "utf-8")


def case_path(folder: Path, name: str) -> Path:
    return (folder / TRIALS[name].case).with_name(f"trial of {name}.nml")


def run(folder: Path, out: Path) -> None:
    """Run every trial; then a case in shards, a case that is killed and resumed, and a case in each
    mode of lanes."""
    out.mkdir(parents=True, exist_ok=True)
    for name, trial in TRIALS.items():
        simulate(case_path(folder, name), out / f"{name}.nc", *trial.words)
        print(name, flush=True)
    in_shards(case_path(folder, "method B"), out)
    killed_and_resumed(folder / "vaujany/many.nml", out / f"{RESUMED}.nc")
    case = rockfall.read_case(case_path(folder, "every map"))
    for name, lanes in LANES.items():
        scene = read_scene(case)
        _core.carry_in_lanes(scene.kernel.handle, lanes)
        rockfall.write_result(run_scene(scene), out / f"{CARRIED} {name}.nc")


def simulate(case: Path, target: Path, *words: str) -> None:
    command = ["run", str(case), "--quiet", "--overwrite", "-o", str(target), *words]
    if status := rockfall_main(command):
        sys.exit(f"{target.stem}: rockfall run ends with {status}")


def in_shards(case: Path, out: Path) -> None:
    parts = [out / f"part {k}.nc" for k in (1, 2, 3)]
    for k, part in enumerate(parts, 1):
        simulate(case, part, "--shard", f"{k}/3")
    merge = ["merge", "--overwrite", "-o", str(out / f"{SHARDED}.nc"), *map(str, parts)]
    if rockfall_main(merge):
        sys.exit(f"{SHARDED}: rockfall merge fails")
    for part in parts:
        part.unlink()


def killed_and_resumed(case: Path, target: Path) -> None:
    """Kill a run at its first checkpoint, and resume it."""
    target.unlink(missing_ok=True)
    checkpoint = target.with_name(f"{target.name}.checkpoint")
    command = [sys.executable, "-m", "rockfall", "run", case, "--quiet", "--threads", "1"]
    process = subprocess.Popen([*command, "--checkpoint", "0.1", "-o", target])
    while not checkpoint.exists() and process.poll() is None:
        time.sleep(0.01)
    process.kill()
    process.wait()
    if target.exists() or not checkpoint.exists():
        sys.exit(f"{RESUMED}: the run ended before it was killed")
    simulate(case, target, "--resume")


def prepare(folder: Path, ready: Path) -> None:
    """Prepare every trial for rockfall-batch; options that it lacks do not change results."""
    for name, trial in TRIALS.items():
        words = trial.words if "--variant" in trial.words else ()
        command = ["prepare", str(case_path(folder, name)), str(ready / name), *words]
        if rockfall_main(command):
            sys.exit(f"{name}: rockfall prepare fails")


def batch(ready: Path, out: Path, program: tuple[str, ...]) -> None:
    """Run every prepared trial on two threads."""
    out.mkdir(parents=True, exist_ok=True)
    command = [*program, "--quiet", "--threads", "2", "--overwrite"]
    for case in sorted(ready.glob("*/case.nml")):  # paths without a drive letter
        paths = (
            case.relative_to(ready),
            "-o",
            os.path.relpath(out / f"{case.parent.name}.nc", ready),
        )
        subprocess.run([*command, *paths], check=True, cwd=ready, stdin=subprocess.DEVNULL)
        print(case.parent.name, flush=True)


def compare(one: Path, other: Path) -> dict[str, list[str]]:
    """Names of variables that are not bit-identical, for each result that is in either folder."""
    names = {path.name for folder in (one, other) for path in folder.glob("*.nc")}
    return {
        Path(name).stem: differing(one / name, other / name)
        if (one / name).exists() and (other / name).exists()
        else ["only one of them"]
        for name in sorted(names)
    }


def differing(one: Path, other: Path) -> list[str]:
    """Variables in only one of two results, or not bit-identical, with the relative difference."""
    with xr.open_dataset(one, decode_cf=False) as a, xr.open_dataset(other, decode_cf=False) as b:
        names = sorted(map(str, {*a.variables} ^ {*b.variables}))
        for name in sorted({*map(str, a.variables)} & {*map(str, b.variables)}):
            x, y = a[name].values, b[name].values
            if x.dtype.kind in "OSU":
                names += [name] * (x.tolist() != y.tolist())
            elif (x.dtype, x.shape) != (y.dtype, y.shape) or x.tobytes() != y.tobytes():
                names.append(f"{name} ({distance(x, y)})")
    return names


def distance(x: np.ndarray, y: np.ndarray) -> str:
    if x.shape != y.shape:
        return f"{x.shape} and {y.shape}"
    with np.errstate(all="ignore"):
        apart = np.abs(x.astype(float) - y) / np.maximum(np.abs(x), np.abs(y))
    return f"{int((x != y).sum())} values by up to {np.nanmax(apart, initial=0.0):.1g}"


def main(command: str, one: str, *more: str) -> str | None:
    place, *others = (Path(folder).resolve() for folder in (one, *more[:1]))
    if command == "make":
        make(place)
    elif command in ("run", "prepare"):
        {"run": run, "prepare": prepare}[command](place, *others)
    elif command == "batch":
        batch(place, *others, more[1:])
    else:
        found = compare(place, *others)
        different = {name: names for name, names in found.items() if names}
        for name, names in different.items():
            print(f"{name}: {', '.join(names)}")
        print(f"{len(found) - len(different)} of {len(found)} results are equal bit by bit")
        return "results differ" if different or not found else None
    return None


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
