# SPDX-License-Identifier: BSD-3-Clause
"""Cost of products: report, PDF, hazard, dossier, export, lines, figures, by several builds.

    python -m benchmarks.speed.products [--boulders 100000] [--repeat 3] [--commit 7080d106]
        [--other PYTHON ...] [--commands report pdf hazard dossier export lines figures]

The slope of `cases/vaujany` with seven maps; for the hazard, `cases/settlement` with few boulders,
so that file access dominates; for the dossier, `cases/decision` unchanged, with four variants of
three scenarios and a second model. `--commit` builds that commit and the current sources as for a
release; `--other` gives Pythons of other builds. All take turns, each with its own result; results
are minima over the turns, with the ratio to the first build. On a busy machine use the CPU times.
"""

import argparse
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.builds import pythons_of
from benchmarks.machine import ROOT, VAUJANY, best_turns, machine, run_child

MB = 1e6
MAPS = (
    "passages", "reach_probability", "deposits", "energy_max", "energy_q95", "speed_q95",
    "jump_height_q95",
)  # fmt: skip
SETTLEMENT, DECISION = ROOT / "cases/settlement", ROOT / "cases/decision"
LAYERS = ROOT / "cases/tutorial/make_layers.py"  # script of the decision's layers
COMMANDS = {
    "report": "report out.nc -o out.html --overwrite",
    "pdf": "report out.nc --pdf --language de -o out.pdf --overwrite",
    "hazard": "hazard settlement/case.nml --objects settlement/objects.geojson --boulders 5 "
    "--quiet -o hazard --overwrite",
    "dossier": "dossier decision/decision.nml --objects decision/houses.gpkg --objects "
    "decision/traffic.gpkg --quiet -o dossier --overwrite",
    "export": "export out.nc exported --overwrite",
    "lines": "lines out.nc",
    "figures": "figures out.nc figures --overwrite",
}


CASE = """&case boulders = {boulders}, seed = 20090601, title = 'Vaujany, method B' /
&terrain dem = '{place}/dem.tif' /
&surface zones = '{place}/zones.tif', table = '{place}/zones.csv', method = 'B' /
&impact sets = '{sets}' /
&boulder volume = 'normal', volume_mean = 0.8, volume_std = 0.15, density = 2800.0 /
&release x = 100.0, y = 587.5, drop_height = 5.0 /
&line name = 'EL1', x = 1.25, 198.75, y = 441.72, 441.72 /
&line name = 'EL2', x = 1.25, 198.75, y = 402.32, 402.32 /
&output maps = {maps}, rebounds = .true., trajectories = 50 /
"""  # only keys known to all builds


def prepare(python: str, folder: Path, boulders: int) -> None:
    """Make the result with a build, and copy the cases of the hazard and of the dossier."""
    sets = ROOT / "python/rockfall/data/impact_sets/bourrier2009.nml"
    maps = ", ".join(f"'{name}'" for name in MAPS)
    text = CASE.format(boulders=boulders, place=VAUJANY.parent, sets=sets, maps=maps)
    (folder / "out.nml").write_text(text)
    words = "run out.nml -o out.nc --overwrite --quiet"
    run_child(python, "-m", "rockfall", *words.split(), cwd=folder)
    shutil.copytree(SETTLEMENT, folder / "settlement")
    table = folder / "settlement/zones.csv"
    rows = [line.split(",") for line in table.read_text().splitlines()]
    table.write_text("\n".join(",".join(row[:2]) for row in rows) + "\n")  # known to any build
    run_child(sys.executable, SETTLEMENT / "make_terrain.py", folder / "settlement")
    shutil.copytree(DECISION, folder / "decision")
    run_child(sys.executable, LAYERS, cwd=folder / "decision")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--boulders", type=int, default=100_000)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--commit", nargs="*", default=[])
    parser.add_argument("--other", nargs="*", default=[])
    parser.add_argument("--commands", nargs="+", default=list(COMMANDS), choices=COMMANDS)
    given = parser.parse_args()
    print(machine())
    print(f"{given.boulders:,} boulders, {len(MAPS)} maps")
    with TemporaryDirectory(dir=Path.cwd()) as top:
        pythons = pythons_of(given.commit, given.other, Path(top))
        folders = [Path(top) / f"{k}" for k in range(len(pythons))]
        for python, folder in zip(pythons, folders, strict=True):
            folder.mkdir()
            prepare(python, folder, given.boulders)
        for command in given.commands:
            best = best_turns(pythons, folders, COMMANDS[command].split(), given.repeat)
            for python, (wall, cpu, peak) in zip(pythons, best, strict=True):
                print(f"{command:7} {wall:6.1f} s, {cpu:6.1f} s of CPU ({cpu / best[0][1]:.2f}), "
                      f"{peak / MB:6,.0f} MB  {python}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
