#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# GDAL 3.12.2 (rasterio 1.5.2) and 3.10.3 ignore scales that SAGA and GRASS write in the headers of their grids.
#
# Expected: elevations as in the program that wrote the file, in the values or as scale and offset of the band; a cell
# without a value is nodata. SAGA multiplies by Z_FACTOR and adds Z_OFFSET; GRASS (r.in.ascii) multiplies by multiplier,
# and "*" is a cell without a value.
# Happens: GDAL returns the stored numbers with scale 1 and offset 0. In a GRASS text grid without a line "null", cells
# with "*" become 0, and the band has no nodata value.
# Matters: terrain stored in centimetres becomes a hundred times as high, and a hole becomes a pit down to sea level.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --only-binary :all: rasterio==1.4.4 numpy==2.2.6
cd "$folder"
"$folder/venv/bin/python" - <<'PY'
from array import array
from pathlib import Path

import rasterio

print("rasterio", rasterio.__version__, "GDAL", rasterio.__gdal_version__)
SAGA = """NAME = dem
DATAFORMAT = SHORTINT
BYTEORDER_BIG = FALSE
POSITION_XMIN = 1
POSITION_YMIN = 1
CELLCOUNT_X = 2
CELLCOUNT_Y = 1
CELLSIZE = 2
Z_FACTOR = 0.01
Z_OFFSET = 300
NODATA_VALUE = -1
TOPTOBOTTOM = FALSE
"""
GRASS = """north: 2
south: 0
east: 4
west: 0
rows: 1
cols: 2
"""
Path("saga.sgrd").write_text(SAGA)
Path("saga.sdat").write_bytes(array("h", [10000, 20000]).tobytes())
Path("multiplier.txt").write_text(GRASS + "multiplier: 0.01\n10000 20000\n")
Path("hole.txt").write_text(GRASS + "1200.5 *\n")
EXPECTED = {"saga.sdat": [400, 500], "multiplier.txt": [100, 200], "hole.txt": [1200.5, None]}
HAPPENS = {"saga.sdat": [10000, 20000], "multiplier.txt": [10000, 20000], "hole.txt": [1200.5, 0]}
for name, expected in EXPECTED.items():
    with rasterio.open(name) as file:
        scale, offset = file.scales[0], file.offsets[0]
        cells = zip(file.read(1)[0].tolist(), file.read_masks(1)[0].tolist())
        found = [scale * value + offset if valid else None for value, valid in cells]
        print(f"{name} ({file.driver}): expected {expected}, found {found}, nodata {file.nodata}")
    assert found == HAPPENS[name], "the behaviour has changed"
PY
