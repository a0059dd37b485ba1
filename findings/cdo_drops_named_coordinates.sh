#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# CDO 2.1.1 copies a netCDF file without the variables on a dimension with a text coordinate, and exits with status 0.
#
# Expected: CF (1.11, section 6.1) allows labels: a coordinate variable of strings, such as names of evaluation lines
# or gauges. A program that does not support labels can still copy the numbers.
# Happens: `cdo copy` omits the coordinate and every variable on its dimension. It prints one line per variable to the
# standard error, but the status is 0, so a pipeline continues with the remaining variables. If the coordinate is a
# number and the names are in another variable that no `coordinates` attribute lists, only the names are lost.
# Matters: results at named lines are the main results of a study. Maps in the same file are copied, so the copy looks
# complete.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
command -v cdo >/dev/null || apt-get install -qq -y --no-install-recommends cdo >/dev/null
cdo -V 2>&1 | head -1
python3 -m venv env
env/bin/pip install -q netCDF4==1.7.2 numpy==1.26.4
cat >write.py <<'END'
import netCDF4, numpy as np

names = np.array(["road", "path"], object)
for file, is_text in (("text.nc", True), ("number.nc", False)):
    with netCDF4.Dataset(file, "w") as data:
        data.Conventions = "CF-1.11"
        data.createDimension("line", 2)
        data.createDimension("block", 3)
        if is_text:
            data.createVariable("line", str, ("line",))[:] = names
        else:
            data.createVariable("line", "i4", ("line",))[:] = [0, 1]
            data.createVariable("line_name", str, ("line",))[:] = names
        data.createVariable("block", "i4", ("block",))[:] = [1, 2, 3]
        for name, dims, units in (("speed", ("line", "block"), "m s-1"), ("volume", ("block",), "m3")):
            variable = data.createVariable(name, "f8", dims)
            variable.units = units
            variable[:] = np.arange(float(np.prod(variable.shape))).reshape(variable.shape)
END
env/bin/python write.py
for file in text number; do
   cdo -s copy "$file.nc" "$file-copy.nc" 2>"$file.err" && echo "$file: status 0"
   sed 's/^/  /' "$file.err"
   env/bin/python -c "import netCDF4; print('  kept:', *netCDF4.Dataset('$file-copy.nc').variables)" | tee "$file.kept"
done
! grep -q speed text.kept && grep -q volume text.kept || { echo "the variable is kept now"; exit 1; }
grep -q speed number.kept || { echo "with a number it is lost, too"; exit 1; }
