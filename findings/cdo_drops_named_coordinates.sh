#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# CDO 2.1.1 copies a netCDF file without the variables on a dimension whose coordinate is text, and ends with status 0.
#
# Expected: CF (1.11, section 6.1) allows labels: a coordinate variable of strings, such as the names of
# evaluation lines or of gauges. What does not understand the names can still copy the numbers.
# Happens: `cdo copy` leaves out the coordinate and every variable on its dimension. One line a variable on
# the standard error says so, the status is 0, and a pipeline goes on with what is left. With a number as
# coordinate and the names in a variable next to it, which no `coordinates` names, only the names are lost.
# Matters: results at named lines are the numbers that a study is made for; maps of the same file survive,
# so that the copy looks whole.
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
