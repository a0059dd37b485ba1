# SPDX-License-Identifier: BSD-3-Clause
"""Cost of a rebound in this program and in PlatRock: same terrain, release and rebound model.

    apt-get install python3-gdal libgdal-dev
    python3 -m venv ~/platrock && ~/platrock/bin/pip install platrock
    python -m benchmarks.speed.platrock ~/platrock/bin/python [--rocks 100]

Terrain and release of cases/vaujany, boulders of 0.8 m3, and the rebound of Bourrier and Hungr
(2011), which both programs have, with the same parameters everywhere. Both run on one thread.
PlatRock uses triangles and time steps (0.02 s by default), this program bilinear patches and no
steps. Stopping rules differ, hence also the numbers of rebounds: compare the time per rebound.
Reading and writing files is excluded.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import rasterio

import rockfall
from benchmarks.machine import VAUJANY, machine

#: R_t, v_half [m/s], friction angle [degree]; roughness in PlatRock [m], our tilt [degree].
GROUND = {"R_t": 0.7, "v_half": 5.0, "phi": 30.0, "roughness": 0.3}
TILT = 25.0  # atan(0.3 m / 0.58 m), with the radius of 0.8 m3
TABLE = f"""\
name,id,model,r_t,half_speed,friction_angle,roughness_angle,source
ground,1,bourrier_hungr,{GROUND["R_t"]},{GROUND["v_half"]},{GROUND["phi"]},{TILT},benchmark
"""
PLATROCK = """
import json, sys, time
sys.path.append("/usr/lib/python3/dist-packages")  # Debian's GDAL for Python
from platrock.Common import BounceModels
from platrock.ThreeD import Objects, Simulations
BounceModels.Toe_Tree_2022 = lambda: None  # forest model that downloads data
dem, release, ground, rocks = sys.argv[1:]
terrain = Objects.Terrain(DEM_asc=dem)
run = Simulations.Simulation(
    terrain=terrain, rocks_start_params_geojson=release, random_seed=1, name="run"
)
run.override_rebound_params = True
for key, value in (json.loads(ground) | {"bounce_model_number": 2}).items():
    setattr(run, "override_" + key, value)
begin = time.process_time()
run.run()
seconds = time.process_time() - begin
assert run.status == "finished", run.status
contacts = [len(run.output.get_contacts_pos(k)) - 2 for k in range(run.nb_rocks)]
print("RESULT", json.dumps([seconds, sum(contacts), run.nb_rocks]))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("python", type=Path, help="a Python that has platrock")
    parser.add_argument("--rocks", type=int, default=100, help="of PlatRock")
    parser.add_argument("--boulders", type=int, default=100_000, help="of ours")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = {"PlatRock": _platrock(given.python, given.rocks, folder)}
        rows["rockfall"] = _rockfall(given.boulders, folder)
    print(machine())
    print(f"{'':10s}{'boulders':>10s}{'rebounds each':>15s}{'us a rebound':>14s}{'us each':>12s}")
    for who, (seconds, rebounds, boulders) in rows.items():
        print(
            f"{who:10s}{boulders:10,d}{rebounds / boulders:15.1f}"
            f"{1e6 * seconds / rebounds:14.3f}{1e6 * seconds / boulders:12.1f}"
        )


def _platrock(python: Path, rocks: int, folder: Path) -> tuple[float, int, int]:
    with rasterio.open(VAUJANY.parent / "dem.tif") as dem:
        z, cell = dem.read(1), dem.res[0]
    head = f"ncols {z.shape[1]}\nnrows {z.shape[0]}\nxllcorner 0\nyllcorner 0\ncellsize {cell}\n"
    lines = [" ".join(f"{value:.4f}" for value in row) for row in z]
    (folder / "dem.asc").write_text(head + "NODATA_value -9999\n" + "\n".join(lines) + "\n")
    side = [[99, 586.5], [101, 586.5], [101, 588.5], [99, 588.5], [99, 586.5]]
    about = {
        "number": rocks, "z": 5.0, "rocks_min_vol": 0.8, "rocks_max_vol": 0.8, "density": 2800,
        "vz": 0,
    }  # fmt: skip
    shape = {"type": "Polygon", "coordinates": [side]}
    features = [{"type": "Feature", "properties": about, "geometry": shape}]
    release = {"type": "FeatureCollection", "features": features}
    (folder / "release.geojson").write_text(json.dumps(release))
    (folder / "run").mkdir()
    (folder / "program.py").write_text(PLATROCK)
    words = [python, "program.py", "dem.asc", "release.geojson", json.dumps(GROUND), str(rocks)]
    done = subprocess.run([*map(str, words)], cwd=folder, capture_output=True, text=True)
    found = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
    if done.returncode or not found:
        sys.exit(f"{done.stdout}\n{done.stderr}")
    seconds, contacts, count = json.loads(found[0].removeprefix("RESULT "))
    return seconds, contacts, count


def _rockfall(boulders: int, folder: Path) -> tuple[float, int, int]:
    (folder / "grounds.csv").write_text(TABLE)
    case = rockfall.read_case(VAUJANY).replace(
        case={"boulders": boulders, "threads": 1},
        terrain={"dem": VAUJANY.parent / "dem.tif"},
        surface={"ground_table": folder / "grounds.csv", "ground": "ground", "zones": None,
                 "table": None, "uniform_mean_radius": 0.0},
        boulder={"volume": "fixed", "volume_mean": 0.8, "volume_std": None},
        output={"maps": None, "trajectories": 0, "rebounds": False, },
        line=[],
    )  # fmt: skip
    result = rockfall.run(case)
    return result.attrs["cpu_seconds"], int(result["rebounds"]), boulders


if __name__ == "__main__":
    main()
