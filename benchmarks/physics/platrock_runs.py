# SPDX-License-Identifier: BSD-3-Clause
"""Stopping places by PlatRock, from the files of cases/tschamut/make_case.py.

PlatRock 3D with the rebound of Bourrier and Hungr (2011) and its default parameters, as in the
ground `bourrier_hungr`; spheres, a time step of 0.02 s, and PlatRock's stopping rule.
benchmarks.speed.platrock explains its installation.
"""

import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

NAME = "PlatRock, Bourrier-Hungr, its defaults"
GROUND = {"R_t": 0.7, "v_half": 5.0, "phi": 30.0, "roughness": 0.1}
ROCKS = 10  # boulders per run
SIDE = 0.05  # half the side of a release square [m]
PROGRAM = """
import json, sys
sys.path.append("/usr/lib/python3/dist-packages")  # Debian's GDAL for Python
from platrock.Common import BounceModels, Math
from platrock.ThreeD import Objects, Simulations
BounceModels.Toe_Tree_2022 = lambda: None  # forest model that downloads data
dem, release, seed, given = sys.argv[1:]
ground, velocities = json.loads(given)

class Simulation(Simulations.Simulation):
    def setup_rock_kinematics(self):
        super().setup_rock_kinematics()
        self.current_rock.vel = Math.Vector3(velocities[self.current_start_params_id])

run = Simulation(
    terrain=Objects.Terrain(DEM_asc=dem), rocks_start_params_geojson=release,
    random_seed=int(seed), name="run",
)
run.override_rebound_params = True
for key, value in (ground | {"bounce_model_number": 2}).items():
    setattr(run, "override_" + key, value)
run.run()
assert run.status == "finished", run.status
places = [run.output.get_contacts_pos(k) for k in range(run.nb_rocks)]
ways = [place[-1][:2] - place[0][:2] for place in places]  # its coordinates have another origin
print("RESULT", json.dumps([[float(value) for value in way] for way in ways]))
"""


class PlatRockError(Exception):
    """PlatRock is missing or failed, with the reason in one line."""


def stops(
    python: Path, folder: Path, seed: int, rocks: int = ROCKS
) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (n, 2) from release to rest [m], and the index of the release of each boulder;
    `folder` has dem.asc and releases.csv. Raises a PlatRockError if PlatRock fails."""
    releases = pd.read_csv(folder / "releases.csv")
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / "dem.asc").write_bytes((folder / "dem.asc").read_bytes())
        (work / "release.geojson").write_text(json.dumps(_collection(releases, rocks)))
        (work / "program.py").write_text(PROGRAM)
        (work / "run").mkdir()
        velocities = releases[["velocity_x", "velocity_y", "velocity_z"]].values.tolist()
        words = [python, "program.py", "dem.asc", "release.geojson", seed]
        words.append(json.dumps([GROUND, velocities]))
        try:
            done = subprocess.run([*map(str, words)], cwd=work, capture_output=True, text=True)
        except OSError as error:
            raise PlatRockError(f"{python}: {error.strerror}") from None
    found = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
    if done.returncode or not found:
        said = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        raise PlatRockError(said[-1] if said else f"exit status {done.returncode}")
    ways = np.array(json.loads(found[0].removeprefix("RESULT ")))
    return ways, np.repeat(np.arange(len(releases)), rocks)


def _collection(releases: pd.DataFrame, rocks: int) -> dict:
    """GeoJSON with a small square for each release."""
    features = []
    for row in releases.itertuples():
        x, y = row.x, row.y
        corners = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
        about = {
            "number": rocks, "z": 0.001, "rocks_min_vol": row.volume, "rocks_max_vol": row.volume,
            "density": row.density, "vz": 0,
        }  # fmt: skip
        ring = [[x + SIDE * a, y + SIDE * b] for a, b in corners]
        shape = {"type": "Polygon", "coordinates": [ring]}
        features.append({"type": "Feature", "properties": about, "geometry": shape})
    return {"type": "FeatureCollection", "features": features}
