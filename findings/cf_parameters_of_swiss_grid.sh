#!/usr/bin/env bash
# pyproj reads the CF parameters that it writes for the Swiss grid as a projection more than 100 km away.
#
# Expected: CRS.to_cf() describes EPSG:2056 (CH1903+ / LV95) as an oblique_mercator, and CRS.from_cf() of these
# parameters gives the same coordinates, as in pyproj 3.8.0.
# Happens: pyproj 3.7.2 reads these parameters (written by 3.8.0 without a warning, by 3.7.2 with a warning) as a
# projection whose coordinates differ by more than 100 km. CF has no angle of the rectified grid: 3.7.2 assumes 0, 3.8.0
# the azimuth.
# Matters: netCDF maps of hazards in Switzerland contain these parameters. A program that uses them instead of crs_wkt
# moves the maps to another country.
#
# Exit status 0 if the behaviour is reproduced.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 3.7.2 3.8.0; do
   python=python3
   [ $version = 3.7.2 ] || for python in python3.14 python3.13 python3.12 python3; do
      command -v $python >/dev/null 2>&1 && $python -c pass 2>/dev/null && break
   done
   $python -m venv $version
   $version/bin/pip install --quiet pyproj==$version netCDF4
done
cat >write.py <<'END'
import sys
import netCDF4, pyproj
parameters = pyproj.CRS.from_epsg(2056).to_cf()
parameters.pop("crs_wkt")
with netCDF4.Dataset(f"{sys.argv[1]}.nc", "w") as file:
    file.createVariable("crs", "i4").setncatts(parameters)
print("written by pyproj", pyproj.__version__, ":", parameters["grid_mapping_name"])
END
cat >read.py <<'END'
import math, sys
import netCDF4, pyproj
with netCDF4.Dataset(f"{sys.argv[1]}.nc") as file:
    parameters = {name: file["crs"].getncattr(name) for name in file["crs"].ncattrs()}
systems = pyproj.CRS.from_epsg(2056), pyproj.CRS.from_cf(parameters)
ways = [pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True) for crs in systems]
apart = 0.0
for name, place in (("Geneva", (6.15, 46.2)), ("Brig", (7.99, 46.32)), ("Chur", (9.53, 46.85))):
    off = math.dist(*(way.transform(*place) for way in ways)) / 1000
    print(f"  {sys.argv[1]}.nc read by pyproj {pyproj.__version__}: {name} is {off:.3f} km off")
    apart = max(apart, off)
sys.exit(0 if (apart > 100 if sys.argv[2] == "far" else apart < 0.001) else 1)
END
for version in 3.7.2 3.8.0; do
   $version/bin/python -W ignore write.py $version
   3.7.2/bin/python -W ignore read.py $version far
   3.8.0/bin/python -W ignore read.py $version near
done
