#!/bin/bash
# SPDX-License-Identifier: BSD-3-Clause
# Two common DXF readers give different areas for a HATCH with islands.
#
# Expected: both give the area that a CAD program fills by the style of the hatch: islands in holes (normal), one level
# of holes (outer), or no holes (ignore).
# Happens: GDAL reads every hatch as normal, whatever its style. ezdxf.addons.geo supports styles, but loses the island
# of a normal hatch, and the second of two areas of a hatch with the style ignore.
# Matters: offices that use CAD deliver release areas, stands and zones as hatches. An island may be a rock face in a
# clearing: if it is lost, no boulder starts there, and no warning appears.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ezdxf==1.4.5 pyogrio==0.13.0 shapely==2.1.2 numpy==2.2.6
cd "$folder"
cat >areas.py <<'END'
import json

import ezdxf
import pyogrio
import shapely
from ezdxf.addons import geo


def square(x, y, side):
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


OUTER, HOLE, ISLAND, SECOND = square(0, 0, 10), square(2, 2, 6), square(4, 4, 2), square(20, 0, 10)
CASES = {  # boundaries with their flags (1 external, 16 outermost), style, area that is filled
    "normal: an island in a hole": ([(OUTER, 1), (HOLE, 16), (ISLAND, 0)], 0, 68),
    "outer: an island in a hole": ([(OUTER, 1), (HOLE, 16), (ISLAND, 0)], 1, 64),
    "ignore: a hole": ([(OUTER, 1), (HOLE, 16)], 2, 100),
    "ignore: two areas": ([(OUTER, 1), (SECOND, 1)], 2, 200),
}
print(f"GDAL {'.'.join(map(str, pyogrio.__gdal_version__))}, ezdxf {ezdxf.__version__}")
wrong = {"GDAL": [], "ezdxf": []}
for name, (boundaries, style, area) in CASES.items():
    drawing = ezdxf.new("R2010")
    hatch = drawing.modelspace().add_hatch(dxfattribs={"hatch_style": style})
    for ring, flags in boundaries:
        hatch.paths.add_polyline_path(ring, is_closed=True, flags=flags)
    assert not drawing.audit().has_errors
    drawing.saveas("hatch.dxf")
    (shape,) = shapely.from_wkb(pyogrio.raw.read("hatch.dxf")[2])
    read = {"GDAL": shape.area}
    (hatch,) = ezdxf.readfile("hatch.dxf").modelspace().query("HATCH")
    read["ezdxf"] = shapely.from_geojson(json.dumps(geo.proxy(hatch).__geo_interface__)).area
    print(f"{name:29} filled {area:3} m2, GDAL {read['GDAL']:3g}, ezdxf {read['ezdxf']:3g}")
    for reader, found in read.items():
        wrong[reader] += [name] * (found != area)
print("wrong:", wrong)
expected = {
    "GDAL": ["outer: an island in a hole", "ignore: a hole"],
    "ezdxf": ["normal: an island in a hole", "ignore: two areas"],
}
raise SystemExit(wrong != expected)
END
"$folder/venv/bin/python" areas.py
