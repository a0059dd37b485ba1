#!/bin/sh
# PlatRock 0.4.6 shifts the terrain by half a cell relative to all other input.
#
# Expected: a rock released at a point of a DEM starts above the elevation of the DEM at this point. Elevations of an
# ESRI ASCII grid are at the cell centres.
# Happens: elevations are placed at the south-west corners of the cells (RasterTools.from_asc: X = 0, cell, 2 cell ...),
# but release polygons, soils, checkpoints and trees are not shifted, so the slope is half a cell too far west and south.
# Matters: with cells of 10 m on a slope of 45 degrees, rocks start 5 m too high or too low, and a road at the foot is
# half a cell too near or too far.
# Needs Debian's python3-gdal, libgdal-dev (apt-get, as root). PlatRock's data of trees, which it downloads, are omitted:
# the case has no trees.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
if ! { command -v gdal-config && /usr/bin/python3 -c 'import osgeo, venv'; } >/dev/null 2>&1; then
   apt-get install -qq -y --no-install-recommends python3-gdal libgdal-dev python3-venv python3-dev g++ >/dev/null
fi
/usr/bin/python3 -m venv --system-site-packages "$folder/python"
"$folder/python/bin/pip" install --quiet platrock==0.4.6
cd "$folder"
mkdir home
HOME=$folder/home "$folder/python/bin/python" - <<'PY'
import json

import platrock
from platrock.Common import BounceModels

BounceModels.Toe_Tree_2022 = lambda: None
from platrock.ThreeD import Objects, Simulations

print("platrock", platrock.version)
cell, n, west, south, drop = 10.0, 12, 1000.0, 2000.0, 0.5
planes = {"rising east": lambda x, y: x, "rising north": lambda x, y: y}
for name, plane in planes.items():
    rows = [
        " ".join(f"{plane((i + 0.5) * cell, (n - j - 0.5) * cell):g}" for i in range(n))
        for j in range(n)
    ]
    head = f"ncols {n}\nnrows {n}\nxllcorner {west}\nyllcorner {south}\ncellsize {cell}\n"
    with open("dem.asc", "w") as file:
        file.write(head + "NODATA_value -9999\n" + "\n".join(rows) + "\n")
    x, y, d = 62.3, 57.1, 1e-3  # of the release, from the corner of the DEM
    ring = [[west + x + d * a, south + y + d * b] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))]
    rock = {"number": 1, "z": drop, "rocks_min_vol": 1.0, "rocks_max_vol": 1.0, "density": 2700, "vz": 0}
    feature = {"type": "Feature", "properties": rock, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    with open("rocks.geojson", "w") as file:
        json.dump({"type": "FeatureCollection", "features": [feature]}, file)
    run = Simulations.Simulation(
        terrain=Objects.Terrain(DEM_asc="dem.asc"), rocks_start_params_geojson="rocks.geojson",
        random_seed=1, name=".",
    )
    run.before_run_tasks()
    run.before_rock_launch_tasks()
    started = run.current_rock.pos[2] - drop - run.current_rock.radius
    print(f"plane {name}, cells of {cell:g} m: ground below the rock {started:.2f} m, in the DEM {plane(x, y):.2f} m")
    assert abs(started - plane(x, y) - cell / 2) < 0.01, "the behaviour has changed"
PY
