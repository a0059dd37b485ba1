#!/usr/bin/env bash
# rasterio warps heights in feet to a CRS with heights in metres, but leaves the numbers in feet.
#
# Expected: a DEM in EPSG:2263+6360 (plan and NAVD88 heights in US survey feet), warped to EPSG:32618+5703 (UTM and
# NAVD88 heights in metres), has heights in metres: 1000 ft are 304.8 m. PROJ (304.8006) and gdalwarp convert them.
# Happens: `rio warp`, rasterio.warp.reproject and WarpedVRT return 1000, in a file whose CRS and band indicate metres.
# Slopes are then 3.28 times as steep.
# Matters: DEMs of the United States are often in feet, and models of natural hazards need metres. Nothing in the new
# file shows that its heights are in feet.
#
# Exit status 0 if the behaviour is reproduced.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet rasterio==1.4.4 pyproj==3.7.2 click==8.1.8
cat >make.py <<'END'
import numpy, rasterio
profile = {"driver": "GTiff", "width": 40, "height": 40, "count": 1, "dtype": "float32"}
place = rasterio.Affine(10, 0, 980000, 0, -10, 200000)
with rasterio.open("feet.tif", "w", **profile, crs="EPSG:2263+6360", transform=place,
                   nodata=-9999) as file:
    file.write(numpy.full((40, 40), 1000, "float32"), 1)
END
cat >show.py <<'END'
import sys
import numpy, pyproj, rasterio
from rasterio.vrt import WarpedVRT
from rasterio.warp import calculate_default_transform, reproject
target = "EPSG:32618+5703"
print("rasterio", rasterio.__version__, "GDAL", rasterio.__gdal_version__)
way = pyproj.Transformer.from_crs("EPSG:2263+6360", target, always_xy=True)
print("PROJ: 1000 ft are", round(way.transform(980200, 199800, 1000)[2], 4), "m")
found = []
with rasterio.open("feet.tif") as feet:
    print("feet.tif:", feet.read(1)[20, 20], feet.units[0])
    with WarpedVRT(feet, crs=target) as warped:
        found.append(float(warped.read(1)[20, 20]))
    place, width, height = calculate_default_transform(feet.crs, target, 40, 40, *feet.bounds)
    array, _ = reproject(rasterio.band(feet, 1), numpy.zeros((height, width), "float32"),
                         dst_transform=place, dst_crs=target)
    found.append(float(array[height // 2, width // 2]))
with rasterio.open("warped.tif") as warped:
    found.append(float(warped.read(1)[20, 20]))
    axes = pyproj.CRS.from_wkt(warped.crs.to_wkt()).axis_info
    print("warped.tif: unit of the band", warped.units[0], "- of heights by the CRS", axes[2].unit_name)
print("WarpedVRT, reproject, rio warp:", *found)
sys.exit(0 if found == [1000.0] * 3 and axes[2].unit_name == "metre" else 1)
END
venv/bin/python make.py
venv/bin/rio warp feet.tif warped.tif --dst-crs EPSG:32618+5703
venv/bin/python show.py
