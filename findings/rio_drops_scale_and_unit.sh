#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# The commands of rasterio 1.4.4 that write a raster (rio convert, clip, warp, merge, mask) drop the scale, offset, unit
# and description of its band.
#
# Expected: a copy, a part or a resampled raster has the values of the original, as by rasterio.shutil.copy.
# Happens: the stored numbers are copied, but not the scale and offset that convert them to values, nor their unit.
# No message appears. `rio edit-info`, which changes the file in place, keeps them.
# Matters: terrain stored as integers (scale 0.01) becomes a hundred times as high after a clip to the project area; the
# slopes of a terrain in feet become three times as steep for a reader that converts only declared units.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --only-binary :all: rasterio==1.4.4 numpy==2.2.6 click==8.1.8
cd "$folder"
PATH=$folder/venv/bin:$PATH
python - <<'PY'
import numpy as np
import rasterio
import rasterio.shutil

about = {"height": 4, "width": 4, "count": 1, "dtype": "int16", "nodata": -1, "crs": "EPSG:32632"}
place = rasterio.Affine(2, 0, 400000, 0, -2, 5000008)
with rasterio.open("dem.tif", "w", driver="GTiff", transform=place, **about) as file:
    file.write(np.arange(10000, 10016, dtype="int16").reshape(4, 4), 1)
    file.scales, file.offsets, file.units = (0.01,), (300.0,), ("ft",)
    file.set_band_description(1, "elevation")
rasterio.shutil.copy("dem.tif", "copy.tif")
PY
cat >area.json <<'END'
{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon",
"coordinates": [[[400000, 5000000], [400008, 5000000], [400008, 5000008], [400000, 5000008], [400000, 5000000]]]}}]}
END
rio convert dem.tif convert.tif
rio clip dem.tif clip.tif --bounds "400000 5000000 400008 5000008"
rio warp dem.tif warp.tif --res 2
rio merge dem.tif merge.tif
rio mask dem.tif mask.tif --geojson-mask area.json
python - <<'PY'
import rasterio

def about(name):
    with rasterio.open(name) as file:
        return file.read(1).tolist(), file.scales[0], file.offsets[0], file.units[0], file.descriptions[0]

print("rasterio", rasterio.__version__, "GDAL", rasterio.__gdal_version__)
stored, *given = about("dem.tif")
print("dem.tif: scale, offset, unit, description", given)
assert about("copy.tif") == (stored, *given), "the behaviour has changed"
for command in "convert", "clip", "warp", "merge", "mask":
    numbers, *kept = about(f"{command}.tif")
    print(f"rio {command}: {kept}, stored numbers {'equal' if numbers == stored else 'differ'}")
    assert numbers == stored and kept == [1, 0, None, None], "the behaviour has changed"
PY
