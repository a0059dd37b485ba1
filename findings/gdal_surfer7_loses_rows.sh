#!/bin/sh
# GDAL 3.12.2 (rasterio 1.5.2) loses rows of a raster copied to a Surfer 7 binary grid (GS7BG).
#
# Expected: the grid has all rows of the raster.
# Happens: the number of columns is used as the number of rows. Of a raster taller than wide, only the upper square is
# written, without an error; for a raster wider than tall, an error is raised. GDAL 3.10.3 (rasterio 1.4.4) writes all
# rows, and both versions read such grids correctly.
# Matters: boulders leave a truncated terrain in the middle of the slope.
# Needs Python 3.12 or later in PATH.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python=
for name in python3 python3.14 python3.13 python3.12 "${HOME-}"/.pyenv/versions/3.1[2-9].*/bin/python3; do
   if "$name" -c 'import sys; sys.exit(sys.version_info < (3, 12))' 2>/dev/null; then python=$name; break; fi
done
[ -n "$python" ] || { echo "needs Python 3.12 or later"; exit 1; }
"$python" -m venv "$folder/python"
"$folder/python/bin/pip" install --quiet --only-binary :all: rasterio==1.5.2 numpy==2.3.5
cd "$folder"
"$folder/python/bin/python" - <<'PY'
import numpy as np
import rasterio
import rasterio.shutil

print("rasterio", rasterio.__version__, "GDAL", rasterio.__gdal_version__)
transform = rasterio.Affine(5, 0, 100, 0, -5, 200)
lost = {}
for rows, columns in (6, 5), (4, 4), (5, 6):
    z = np.arange(1.0, rows * columns + 1, dtype="float32").reshape(rows, columns)
    with rasterio.open("a.tif", "w", driver="GTiff", height=rows, width=columns, count=1,
                       dtype="float32", transform=transform) as file:
        file.write(z, 1)
    try:
        rasterio.shutil.copy("a.tif", "a.grd", driver="GS7BG")
    except Exception as error:
        lost[rows, columns] = "error"
        print(f"{rows} rows, {columns} columns: {str(error).splitlines()[0]}")
        continue
    with rasterio.open("a.grd") as file:
        lost[rows, columns] = rows - file.height
        print(f"{rows} rows, {columns} columns: {file.height} rows written, maximum "
              f"{file.read(1).max():g} of {z.max():g}")
assert lost == {(6, 5): 1, (4, 4): 0, (5, 6): "error"}, "the behaviour has changed"
PY
