# SPDX-License-Identifier: BSD-3-Clause
"""Each likely mistake gives one line; correct scenes give none."""

import math
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from rasterio.crs import CRS
from rasterio.warp import transform

import rockfall
import scenes
from made import PLACE, UTM, make_raster, refused
from programs import refuses
from rockfall.cli import main
from rockfall.io.rasters.dem import read_dem
from rockfall.language import speaking, translated
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible, input_warnings
from rockfall.text.preview import preview

ROOT = Path(__file__).parents[2]
NY, NX, CELL = 80, 60, 5.0
EAST, NORTH = PLACE.c, PLACE.f
TABLE = "zone,mean_radius\n1,0.3\n2,0.2\n3,Inf\n"
POINT = {"x": [EAST + 150.0], "y": [NORTH - 50.0]}
PLAN = "EPSG:3857"
OWN_MEADOW = "name,model,r_n,r_t,roughness_angle,source\nmeadow,constant,0.3,0.8,4,test\n"


class Site:
    """Folder with correct inputs and their case; each mistake changes part of it."""

    def __init__(self, folder):
        self.folder, self.z = folder, scenes.rough(NX, NY, CELL, dtype="f4")
        self.dem(self.z)
        zones = np.where(np.arange(NX) < 30, 1, 2) + np.zeros((NY, 1))
        zones[-5:] = 3
        make_raster(folder / "zones.tif", zones.astype("i2"), nodata=-1)
        cells = np.zeros((NY, NX), "u1")
        cells[8, 10:50] = 1
        self.cells(cells)
        (folder / "zones.csv").write_text(TABLE)
        self.groups = {
            "case": {"boulders": 2},
            "terrain": {"dem": "dem.tif"},
            "surface": {"zones": "zones.tif", "table": "zones.csv"},
            "impact": {},
            "boulder": {"volume_mean": 0.8},
            "release": {**POINT, "drop_height": 2.0},
            "flight": {},
        }

    def dem(self, z, **about):
        make_raster(self.folder / "dem.tif", z, **about)

    def cells(self, array, **about):
        make_raster(self.folder / "cells.tif", array, **about)

    def set(self, group, **keys):
        self.groups[group] = self.groups.get(group, {}) | keys

    def meadow(self, table=None, **impact):
        """Meadow everywhere, from the shipped table of grounds or from `table`."""
        self.set("surface", ground="meadow")
        self.set("impact", **impact)
        if table:
            (self.folder / "own.csv").write_text(table)
            self.set("surface", ground_table="own.csv")

    def by_cells(self):
        self.groups["release"] = {"cells": "cells.tif", "drop_height": 2.0}

    def uniform(self, radius=0.3):
        self.groups["surface"] = {"uniform_mean_radius": radius}

    def case(self):
        return rockfall.Case(folder=self.folder, **self.groups)

    def polygons(self, *boxes, crs=UTM, name="zones.gpkg"):
        """Use a layer of polygons as zones 1, 2, ..., each between a pair of x."""
        import pyogrio
        import shapely

        south, north = NORTH - NY * CELL, NORTH
        shapes = [shapely.box(EAST + low, south, EAST + high, north) for low, high in boxes]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # missing CRS
            pyogrio.raw.write(
                self.folder / name, geometry=np.array([shapely.to_wkb(one) for one in shapes]),
                field_data=[np.arange(1, len(boxes) + 1, dtype="i4")], fields=["zone"],
                geometry_type="Polygon", crs=crs,
            )  # fmt: skip
        self.set("surface", zones=name)


@pytest.fixture
def site(tmp_path):
    return Site(tmp_path)


def lines(site, **options):
    return implausible(read_scene(site.case(), **options))


# ---- mistakes


def undeclared(value, nodata=None):
    def change(site):
        z = site.z.copy()
        z[-6:, :7] = value
        site.dem(z, nodata=nodata)

    return change


def road(west, hole=0):
    """Mistake: a road of 300 m from `west` [m], across a hole of `hole` columns."""

    def change(site):
        z = site.z.copy()
        z[38:43, :hole] = np.nan
        site.dem(z, nodata=np.nan)
        x = [EAST + west, EAST + west + 300.0]
        site.groups["line"] = [{"name": "road", "x": x, "y": [NORTH - 200.0] * 2}]

    return change


def in_degrees(site):
    """Mistake: cells in degrees, undeclared."""
    site.dem(site.z, crs=None, transform=Affine(6e-5, 0, 7.1, 0, -4.5e-5 * 6 / 4.5, 45.1))
    site.uniform()
    site.set("release", x=[7.1 + 30 * 6e-5], y=[45.1 - 10 * 6e-5])


def web_mercator(site):
    (x,), (y,) = transform("EPSG:4326", PLAN, [7.0], [60.0])
    site.dem(site.z, crs=PLAN, transform=Affine(5.0, 0, x, 0, -5.0, y))
    site.uniform()
    site.set("release", x=[x + 150.0], y=[y - 50.0])


def in_feet(site):
    """Mistake: elevations in feet, undeclared, on a slope of 38 degrees."""
    site.dem(site.z / 0.3048)


def mask(inside, outside, declared=None):
    def change(site):
        cells = np.full((NY, NX), outside, "u1")
        cells[8, 10:50] = inside
        site.cells(cells, nodata=declared)
        site.by_cells()

    return change


def lowered(site, by):
    site.z = site.z - by
    return site


def put(group, **keys):
    return lambda site: site.set(group, **keys)


def of_sources(density):
    """Mistake: boulders whose sources give their sides and this density [kg/m3]."""

    def change(site):
        sides = dict.fromkeys(("d1", "d2", "d3"), "side.tif")
        make_raster(site.folder / "side.tif", np.ones((NY, NX), "f4"))
        make_raster(site.folder / "density.tif", np.full((NY, NX), density, "f4"))
        told = {"volume": "source", "rock_density": "density.tif"}
        site.set("boulder", volume_mean=None, **sides, **told)

    return change


def spike(site):
    """Mistake: one cell 400 m too high, as from a bird or a cloud."""
    site.z[40, 20] += 400.0
    site.dem(site.z)


def void(site):
    """Mistake: a hole that was resampled with its nodata value as elevation."""
    site.z[40:44, 20:25] = np.nan
    site.z[39, 20:25] = [-500.0, -7000.0, -3100.0, -6200.0, -900.0]
    site.dem(site.z, nodata=np.nan)


def half_steep_in_feet(site):
    """Mistake: elevations in feet on a slope of 22 degrees, of which less than half appears steeper
    than 60 degrees."""
    site.dem(scenes.rough(NX, NY, CELL, gradient=0.35, relief=6.0, dtype="f4") / 0.3048)


def packed(site):
    """Mistake: elevations packed with a scale and an offset that are only in a file next to the
    raster."""
    site.dem((site.z - 1000.0) * 2)
    (site.folder / "dem.tif.aux.xml").write_text(
        '<PAMDataset><PAMRasterBand band="1"><Offset>1000</Offset><Scale>0.5</Scale>'
        "</PAMRasterBand></PAMDataset>"
    )


def points(*rows):
    """Mistake: sources in a table of `rows` (x, y, volume), several at the same place."""

    def change(site):
        text = "x,y,volume\n" + "".join(f"{EAST + x},{NORTH - y},{v}\n" for x, y, v in rows)
        (site.folder / "sources.csv").write_text(text)
        site.groups["release"] = {"points": "sources.csv", "drop_height": 2.0}

    return change


def obstacles(*rg):
    def change(site):
        names = ("rg70", "rg20", "rg10")
        for name, value in zip(names, rg, strict=True):
            make_raster(site.folder / f"{name}.tif", np.full((NY, NX), value, "f4"))
        site.groups["surface"] = {"method": "A"} | {name: f"{name}.tif" for name in names}

    return change


def trees(*dbh):
    def change(site):
        places = [(EAST + 30 * (k % 9) + 20, NORTH - 30 * (k // 9) - 100) for k in range(len(dbh))]
        rows = [f"{x},{y},{d},spruce\n" for (x, y), d in zip(places, dbh, strict=True)]
        (site.folder / "trees.csv").write_text("x,y,dbh,species\n" + "".join(rows))
        site.set("forest", trees="trees.csv")

    return change


ACROSS = {"x": [EAST + 10.0, EAST + 290.0], "y": [NORTH - 200.0] * 2}
NET = {"name": "net", **ACROSS, "height": 5.0, "class": 3}


def barrier(**keys):
    return put_several("barrier", NET | keys)


def dam(**keys):
    return put_several("dam", ACROSS | keys)


def put_several(group, *members):
    return lambda site: site.groups.update({group: list(members)})


def scenario(**keys):
    return put_several("scenario", {"name": "blocks"} | keys)


def hazard(**keys):
    return lambda site: (scenario(frequency=0.1)(site), site.set("hazard", **keys))


def normal(**keys):
    return put("boulder", volume="normal", **keys)


def pareto(exponent):
    volumes = {"volume_min": 0.1, "volume_max": 9.0, "volume_exponent": exponent}
    return put("boulder", volume="pareto", volume_mean=None, **volumes)


def log(diameter):
    return barrier(diameter=diameter, height=None, **{"class": None})


def forest(dbh, uniform_stems=300.0, **keys):
    stems = {"uniform_stems": uniform_stems, "uniform_dbh_mean": dbh, "uniform_dbh_std": dbh / 5}
    return put("forest", uniform_conifers=80.0, **stems | keys)


def radii(radius):
    return lambda site: (site.folder / "zones.csv").write_text(TABLE.replace("0.2", radius))


MISTAKES = {
    "-9999": (undeclared(-9999), "elevation -9999 m in 42 cells, 10,9.. m below all others: is"),
    "-32768": (undeclared(-32768), "elevation -32768 m in 42 cells, .* below all others: is it"),
    "0": (undeclared(0), "elevation 0 m in 42 cells, 9.. m below all others: is it an undecl"),
    "degrees": (in_degrees, r"look like degrees \(x 7.1 to 7.1036, .*, cells of 0.00006\)"),
    "3857": (web_mercator, r"EPSG:3857 stretches lengths here by a factor of 2\.00 but"),
    "feet": (in_feet, "half of the terrain is steeper than 69 degrees: are elevations in metr"),
    "dm on a gentle slope": (lambda site: site.dem(8e3 + 0.1 * site.z + site.z.max()),
        "the highest elevation is 9,... m, above any mountain: are elevations in another unit?"),
    "integers": (lambda site: site.dem(np.rint(site.z).astype("i2")), "steps that .* up to 11"),
    "mask of 1 and 255": (mask(1, 255), "cells = 'cells.tif': with 255, 4,760 cells become "
                                        "sources"),
    "all cells": (mask(255, 255), "every cell of the terrain is a source: is 255 an undeclared"),
    "R_m in cm": (radii("20"), "a mean radius of 20 m .* is the value in cm"),
    "density": (put("boulder", density=280.0), "density = 280 kg/m3: rock density is 2000 to 3200"),
    "density of sources": (of_sources(275.0), "_density = 275 kg/m3: rock density is 2000 to 3200"),
    "density of a scenario": (scenario(frequency=0.1, density=27.0),
        "&scenario name = 'blocks' density = 27 kg/m3: rock density is 2000 to 3200"),
    "gravity of no planet": (put("flight", gravity=15.0), "gravity = 15 m/s2: gravity on Earth "
                                                          "is 9.81"),
    "gravity in g": (put("flight", gravity=1.0), "gravity = 1 m/s2: gravity on Earth is 9.81"),
    "gravity in ft/s2": (put("flight", gravity=32.2), "gravity = 32.2 m/s2: gravity on Earth is "
                                                      "9.81"),
    "gravity in km/s2": (put("flight", gravity=0.00981), "= 0.00981 m/s2: gravity on Earth is "
                                                         "9.81"),
    "exponent of a density": (pareto(1.6), "&boulder volume_exponent = 1.6: exponents of "
                                           "cumulative numbers are below 1: if the value is the "
                                           "exponent of the probability density, give 0.6"),
    "exponent of a scenario": (scenario(activity=0.1, volume="pareto", volume_min=0.1,
        volume_max=9.0, volume_exponent=1.5), "name = 'blocks' volume_exponent = 1.5: .* give 0.5"),
    "stop_speed in km/h": (put("impact", stop_speed=18.0), "stop_speed = 18 m/s: boulders this "
        "fast keep moving: is the value in km/h?"),
    "rest_angle in radians": (put("impact", rest_angle=0.66), "rest_angle = 0.66 degrees: hardly "
                                                              "any boulder rests at such a small "
                                                              "angle: is the value in radians "
                                                              ".38 degrees.?"),
    "minimum_area in ha": (hazard(minimum_area=0.02),
        "minimum_area = 0.02 m2: smaller than a cell of 25 m2: is the value in hectares?"),
    "cliff_length in cm": (scenario(frequency=1e-4, frequency_per="m", cliff_length=40_000.0),
        "'blocks' cliff_length = 40000 m: longer than the perimeter of the terrain, 1,400 m: "),
    "cliff_length in km": (scenario(frequency=0.1, frequency_per="m", cliff_length=0.8),
        "'blocks' cliff_length = 0.8 m: too short for a cliff: is the value in km?"),
    "a frequency of another unit": (put_several("scenario", {"name": "a", "frequency": 2e-4},
        {"name": "b", "frequency": 0.3}), "name = 'b': 1,500 times as frequent as 'a', the next"),
    "a return period as a frequency": (put_several("scenario", {"name": "a", "frequency": 0.01},
        {"name": "b", "return_period": 0.07}),
        "name = 'b': 1,429 times as frequent as 'a', the next most frequent: is one of the two a "
        "return period"),
    "dem_correlation in km": (put("ensemble", dem_error=1.0, dem_correlation=0.03),
        "dem_correlation = 0.03 m: shorter than half a cell of 5 m: is the value in km?"),
    "source_shift in cm": (put("ensemble", source_shift=300.0), "= 300 m: more than 100 m: is the"),
    "a log by its length": (log(diameter=180.0), "a log of 180 cm: is the value the length, or a "
                                                 "diamet"),
    "clearing of sources in cm": (forest(30.0, clear_of_sources=150.0, stem_height=20.0),
        "&forest clear_of_sources = 150 m: more than 100 m: is the value in cm?"),
    "stem height in dm": (forest(30.0, stem_height=250.0),
        "&forest stem_height = 250 m: more than 60 m: is the value in cm?"),
    "deviation of stems in m": (forest(28.0, uniform_dbh_std=0.12), "dbh_std: 0.12 cm at a mean of "
        "28 cm .100 % of the stems.: is the value in m, or a fraction of the mean?"),
    "deviation of stems as a fraction": (forest(28.0, uniform_dbh_std=0.3), "dbh_std: 0.3 cm at a"),
    "deviation of thin stems as a fraction": (forest(9.0, uniform_dbh_std=0.4), "0.4 cm at a mean"),
    "deviation of stems in percent": (forest(28.0, uniform_dbh_std=30.0), "dbh_std: 30 cm at a mean"
        " of 28 cm .100 % of the stems.: is the value in percent of the mean, or in mm?"),
    "deviation of stems in mm": (forest(28.0, uniform_dbh_std=90.0), "dbh_std: 90 cm at a mean of"),
    "deviation of stems in a raster": (lambda site: (make_raster(site.folder / "std.tif",
        np.full((NY, NX), 0.35, "f4")), forest(28.0, uniform_dbh_std=None,
        dbh_std="std.tif")(site)),
        "&forest dbh_std: 0.35 cm at a mean of 28 cm"),
    "basal area": (forest(90.0, uniform_stems=900.0), "basal area of 60. m2 per hectare, but"),
    "drop": (put("release", drop_height=300.0), "start 300 m above the ground: is the value in c"),
    "speed": (put("release", velocity=[0.0, -80.0, 0.0]), "80 m/s is 288 km/h: is the value in "
                                                          "km/"),
    "volume": (put("boulder", volume_mean=8000.0), "8000 m3: a boulder 25 m across: is the"),
    "-99": (undeclared(-99), "elevation -99 m in 42 cells, 1,0.. m below all others: is it an un"),
    "-1 near the sea": (lambda site: (undeclared(-1)(lowered(site, 900.0))),
        "elevation -1 m in 42 cells, .* m below all others: is it an undeclared n"),
    "void": (void, r"5 cells are below -450 m, the lowest at -7,000 m, lower than any land: was"),
    "spike": (spike, r"1 cells are isolated spikes or pits, the largest .* at 600102.5, 4999797"),
    "feet on a gentler slope": (half_steep_in_feet, "half of the terrain is steeper than 5. deg"),
    "aux.xml": (packed, r"dem.tif \(dem.tif.aux.xml\): the metadata multiply the values by 0.5 "
                        r"and "),
    "volume in litres": (put("boulder", volume_mean=800.0), "800 m3: a boulder 12 m across: is "),
    "volume of a source in litres": (points((100, 50, 0.5), (150, 50, 400.0)),
        "&release source '2' volume_mean = 400 m3: a boulder 9 m across: is the volume in dm3"),
    "volume of a scenario in litres": (scenario(return_period=10.0, volume_mean=500.0),
        "scenario name = 'blocks' volume_mean = 500 m3: a boulder 10 m across: is the volume in d"),
    "wide distribution": (normal(volume_mean=0.8, volume_std=1.0),
        "volume_std = 1 m3: truncated at zero, the normal distribution has a mean of 1.17 m3, "),
    "std in percent": (normal(volume_mean=4.0, volume_std=15.0),
        "has a mean of 13.5 m3, not 4 m3: is the value in percent?"),
    "Rg in the wrong order": (obstacles(0.9, 0.5, 0.2), "rg70, rg20, rg10: obstacles Rg70 "
        "are larger than Rg10 nearly everywhere: check their order"),
    "points of a table given thrice": (points(*3 * [(150, 50, 0.8)], (170, 50, 0.8)),
        r"points = 'sources.csv': the source \(600150, 4999950\) is given 3 times and releases"),
    "stems for each cell": (put("forest", uniform_stems=0.75, uniform_dbh_mean=30.0,
        uniform_dbh_std=5.0, uniform_conifers=50.0),
        "&forest stems: at most 0.75 stems per hectare: are these stems per cell?"),
    "DBH in m among cm": (trees(*20 * [35.0], 0.32, 0.41),
        "2 of 22 stems are thinner than 1.5 cm: are some diameters in m, others in cm?"),
    "net in dm": (barrier(height=50.0), "height = 50 m, but nets are up to 10 m high: is the"),
    "capacity in J": (barrier(capacity=50_000.0, **{"class": None}),
        "capacity = 50,000 kJ, but the strongest nets absorb 10,000 kJ: is the value in J?"),
    "capacity in MJ": (barrier(capacity=1.5, **{"class": None}),
        "name = 'net': capacity = 1.5 kJ, but the weakest nets absorb 100 kJ: is the value in MJ?"),
    "barrier given twice": (put_several("barrier", NET, NET | {"name": "net 2"}),
        "name = 'net 2': coincides with 'net', so boulders meet both and fewer pass"),
    "barrier given twice, in the other direction": (
        put_several("barrier", NET, NET | {"name": "net 2", "x": NET["x"][::-1], "class": 5}),
        "name = 'net 2': coincides with 'net'"),
    "scenario given twice": (
        put_several("scenario", *({"name": name, "frequency": 0.1} for name in ("a", "b"))),
        "name = 'b': repeats the boulders and the frequency of 'a', which count twice"),
    "lognormal in percent": (put("boulder", volume="lognormal", volume_mean=0.8, volume_std=20.0),
        "&boulder volume_std = 20 m3: 25 times volume_mean, .* is the value in percent?"),
    "stems in another unit": (forest(30.0, stem_height=0.25),
        "&forest stem_height = 0.25 m: boulders bounce over stems this low"),
    "thresholds in MJ": (hazard(thresholds=[0.03, 0.3]),
        "&hazard thresholds: the highest threshold is 0.3 kJ, .* is the value in MJ?"),
    "coarse dam": (dam(height=30.0, slope=60.0),
        "&dam 1, height = 30, slope = 60: its face is only 2.. cells wide "
        ".1.* m, cells of 5 m., fewer"),
    "high dam": (dam(height=99.0, slope=60.0), "dams against rockfall are up to 30 m high: is the"),
    "dam by a ratio": (dam(height=25.0, slope=5.5), "a face of 5.5 degrees is a ramp: is the "
                                                    "value a ra"),
    "thresholds in J": (hazard(thresholds=[30.0, 30_000.0]),
        "&hazard thresholds: a threshold of 30,000 kJ exceeds every barrier class: is the value "
        "in"),
    "return periods as frequencies": (hazard(return_periods=[0.1, 0.3, 1.0]),
        "&hazard return_periods: a return period of 0.1 years: is the value a frequency?"),
    "frequency as a return period": (scenario(frequency=100.0),
        "&scenario name = 'blocks' frequency = 100, .*: 100 boulders per year: is the value a "
        "return p"),
    "return period as a frequency": (scenario(return_period=0.01),
        "return_period = 0.01, .*: 100 boulders per year: is the value a frequency?"),
    "error of the DEM in cm": (put("ensemble", dem_error=15.0, dem_correlation=30.0),
        "&ensemble dem_error = 15 m: exceeds the cell width of 5 m"),
    "source given thrice": (put("release", x=POINT["x"] * 3, y=POINT["y"] * 3),
        r"the source \(600150, 4999950\) is given 3 times and releases 3 times"),
    "overlapping zones": (lambda site: site.polygons((0, 200), (100, 300)),
        "zones.gpkg: polygons of different zone overlap in 1,600 cells: the later polygon is used"),
    "one rest angle for all": (lambda site: site.meadow(rest_angle=38.0),
        "is 27 to 38 degrees steep and without rocks, so slow boulders may"),
    "meadow without a rest angle": (lambda site: site.meadow(OWN_MEADOW),
        "is 27 to 38 degrees steep and without rocks, so slow boulders may"),
    "road beyond the terrain": (road(-200.0), "&line name = 'road': 202 of 300 m lie outside the"),
    "road over a hole": (road(0.0, 20), "&line name = 'road': 105 of 300 m lie outside the"),
    "zones in another CRS": (lambda site: site.polygons((0, 150), (150, 300), crs="EPSG:25832"),
        "zones.gpkg: reprojected from EPSG:25832 to EPSG:32632.*"),
}  # fmt: skip


@pytest.mark.family(3)
@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_gives_its_line_and_no_other(site, what):
    """The scene of a mistake gives one line, which is translated in each language."""
    change, words = MISTAKES[what]
    change(site)
    scene = read_scene(site.case())
    (line,), ((_, text),) = implausible(scene), input_warnings(scene)
    assert line.startswith("case: &") or "zones.gpkg" in line or "aux.xml" in line
    assert re.search(words, line), line
    assert "\n" not in line
    for language in ("de", "fr", "it"):
        with speaking(language):
            assert translated(text) != text


ABSURD = {  # refused before anything else
    "net in cm": (barrier(height=400.0), "&barrier height = 400.0: must be 0.001 to 100 [m]"),
    "capacity in J": (barrier(capacity=500_000.0, **{"class": None}),
        "&barrier capacity = 500000.0: must be 1e-6 to 100000 [kJ]"),
    "dam in cm": (dam(height=400.0), "&dam height = 400.0: must be 0.001 to 100 [m]"),
    "dam by a ratio": (dam(height=4.0, slope=1.5), "&dam slope = 1.5: must be 5 to 89 [degree]"),
    "dam on coarse cells": (dam(height=5.0, slope=60.0), "&dam height = 5, slope = 60: its face is "
        "0.37 cells wide: resample to 0.46 m, raise it to 27 m, or give allow_coarse = .true."),
    "thresholds in J": (put("hazard", thresholds=[30_000.0, 300_000.0]),
        "&hazard thresholds (value 2) = 300000.0: must be 0 to 100000 [kJ]"),
    "frequencies": (put("hazard", return_periods=[0.0033, 0.01, 0.033]),
        "&hazard return_periods (value 1) = 0.0033: must be 0.1 to 1e6 [year]"),
    "std in percent": (normal(volume_mean=0.8, volume_std=15.0), "&boulder volume_std = 15.0: "
                                                                 "must be at most 5 times "
                                                                 "volume_mean: give it in m3, "
                                                                 "not in percent"),
    "density in t": (put("boulder", density=2.8),
        "&boulder density = 2.8: must be in kg/m3: multiply t/m3 by 1000"),
    "density of a scenario in t": (scenario(frequency=0.1, density=2.7),
        "&scenario density = 2.7: must be in kg/m3: multiply t/m3 by 1000"),
    "gravity in cm": (put("flight", gravity=981.0),
        "&flight gravity = 981.0: must be in m/s2: divide cm/s2 by 100"),
    "error of the DEM in cm": (put("ensemble", dem_error=30.0, dem_correlation=30.0),
        "&ensemble dem_error = 30.0: must be 0 to 20 [m]"),
}  # fmt: skip


@pytest.mark.parametrize("what", ABSURD)
def test_what_cannot_be_meant_is_refused(site, what):
    change, message = ABSURD[what]
    change(site)
    with pytest.raises(rockfall.RockfallError) as error:
        lines(site)
    assert str(error.value) == f"case: {message}"


WINDOWED = [
    "-9999",
    "feet",
    "integers",
    "mask of 1 and 255",
    "R_m in cm",
    "void",
    "spike",
    "aux.xml",
]


@pytest.mark.family(3)
@pytest.mark.parametrize("what", WINDOWED)
def test_terrain_in_windows_is_told_alike(site, what):
    MISTAKES[what][0](site)
    scene = read_scene(site.case(), memory=20 * 1000.0)
    assert scene.windows and implausible(scene) == lines(site)
    whole = read_scene(site.case()).ground
    assert np.array_equal(np.concatenate(scene.ground.source_z), np.concatenate(whole.source_z))
    assert scene.ground.quantiles() == pytest.approx(whole.quantiles(), abs=1e-9)


def test_geocentric_coordinates_are_refused(site):
    path = site.folder / "dem.tif"
    site.dem(site.z, crs="EPSG:4978")
    with refused(
        f"{path}: coordinates are geocentric (EPSG:4978), from the centre of the Earth: "
        "a projected CRS in metres is needed"
    ):
        read_dem(path)


@pytest.mark.parametrize("name", ["x.tif", "x"])
@pytest.mark.parametrize("verb", ["run", "merge"])
def test_results_end_in_nc(site, capsys, monkeypatch, name, verb):
    monkeypatch.chdir(site.folder)
    Path("case.nml").write_text(site.case().text())
    said = f"{name}: results are netCDF files: the output name must end in .nc"
    refuses([verb, "case.nml", "-o", name], said, capsys)


def test_both_commands_and_the_function_say_the_same(site, capsys, monkeypatch):
    monkeypatch.chdir(site.folder)
    site.set("boulder", density=280.0)
    site.set("flight", gravity=98.1)
    Path("case.nml").write_text(site.case().text())
    assert main(["check", "case.nml"]) == 0
    checked = capsys.readouterr().err
    assert main(["run", "case.nml", "--quiet"]) == 0
    assert capsys.readouterr().err == checked
    with pytest.warns(UserWarning) as caught:
        rockfall.run(rockfall.read_case("case.nml"), chunk=1)
    said = [str(one.message) for one in caught if str(one.message).startswith("case.nml: ")]
    assert len(said) == 2 and checked == "".join(f"rockfall: warning: {one}\n" for one in said)
    assert {one.filename for one in caught} == {__file__}


# ---- correct scenes


def test_a_sound_site(site):
    assert lines(site) == []
    site.by_cells()
    assert lines(site) == []
    mask(255, 0)(site)  # mask as in images
    assert lines(site) == []
    mask(1, 255, declared=255)(site)
    assert lines(site) == []
    undeclared(-9999, nodata=-9999)(site)
    assert lines(site) == []
    site.polygons((0, 150), (150, 300))
    assert lines(site) == []
    site.dem(site.z, crs=None)  # without a CRS, values are used unchanged
    site.polygons((0, 150), (150, 300), crs=None)
    assert lines(site) == []


def test_rocks_of_all_sizes_that_slopes_have(site):
    for radius in "0.001", "2.5", "Inf":
        radii(radius)(site)
        assert lines(site) == []
    site.groups["surface"] = {"uniform_rg": [100.0, 100.0, 100.0], "method": "A"}
    assert lines(site) == []


def test_a_local_system_in_metres(site):
    site.dem(site.z, crs=CRS.from_wkt('LOCAL_CS["quarry",UNIT["metre",1]]'))
    site.uniform()
    assert lines(site) == []


@pytest.mark.parametrize(
    "change",
    [
        barrier(capacity=5.0, **{"class": None}),
        put_several("barrier", NET, NET | {"name": "on a wall", "height": 2.0}),
        put_several("barrier", NET, NET | {"name": "below", "y": [NORTH - 201.0] * 2}),
        hazard(thresholds=[0.1, 5.0]),
        put_several("scenario", {"name": "a", "frequency": 0.1}, {"name": "b", "frequency": 0.2}),
        put("boulder", volume="lognormal", volume_mean=0.8, volume_std=4.0),
        forest(30.0, stem_height=2.0),
    ],
)
def test_what_is_unusual_but_may_be_meant(site, change):
    change(site)
    assert lines(site) == []


@pytest.mark.parametrize("crs", ["EPSG:2154", "EPSG:2056"])
def test_projections_of_the_alps(site, crs):
    (x,), (y,) = transform("EPSG:4326", crs, [7.0], [45.5])
    site.dem(site.z, crs=crs, transform=Affine(5.0, 0, x, 0, -5.0, y))
    site.uniform()
    site.set("release", x=[x + 150.0], y=[y - 50.0])
    assert lines(site) == []


def elevations(name):
    """Elevations that may look wrong but are correct: extreme, flat, or round numbers."""
    y, x = np.mgrid[NY - 1 : -1 : -1, 0:NX] * CELL
    sea = np.maximum(scenes.rough(NX, NY, CELL) - 1150.0, 0.0)
    cliff = np.where(y > 200, 250.0, 0.0)
    return {
        "dead sea": scenes.rough(NX, NY, CELL) - 1430.0,
        "plane of integers": y - 0.2 * x,
        "ridge of integers": np.abs(x - 150),
        "terraces": 20 * np.floor(y / 100) + 0 * x,
        "sea": sea,
        "plateau, cliff and plain": cliff + 0 * x,
        "cliff of 55 degrees": 1.45 * y + 0 * x,
        "Everest": scenes.rough(NX, NY, CELL) + 7500.0,
        "flat": 0 * y,
    }[name]


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "name",
    ["dead sea", "plane of integers", "ridge of integers", "terraces", "sea", "Everest", "flat",
     "plateau, cliff and plain", "cliff of 55 degrees"],
)  # fmt: skip
def test_unusual_terrain(site, name):
    site.dem(elevations(name))
    assert lines(site) == []


@pytest.mark.parametrize(
    ("cell", "noise", "slope", "angle"),
    [
        (1.0, 0.1, 34.0, 14),  # sqrt(6) x 0.1 m in a cell of 1 m
        (2.0, 0.2, 34.0, 14),
        (1.0, 0.05, 34.0, None),
        (4.0, 0.4, 34.0, None),  # coarse cells cannot show rocks
        (1.0, 0.1, 10.0, None),
        (1.0, 0.1, 58.0, None),
    ],
)
def test_fine_cells_that_hold_noise_or_rocks_are_named(site, cell, noise, slope, angle):
    fall = np.tan(np.radians(slope)) * cell * np.arange(NY)[:, None]
    z = 2000.0 - fall + np.random.default_rng(1).normal(0.0, noise, (NY, NX))
    site.uniform()
    site.dem(z, transform=Affine(cell, 0, EAST, 0, -cell, NORTH))
    site.set("release", x=[EAST + 30 * cell], y=[NORTH - 10 * cell])
    said = lines(site)
    assert len(said) == (angle is not None)
    for text in said:
        assert f"change by {angle} degrees" in text and f"--smooth {2 * cell:g}" in text


def test_a_saddle_of_integers_has_no_steps(site):
    y, x = np.mgrid[0:NY, 0:NX]
    site.dem(900 - (x - 30.0) ** 2 + (y - 40.0) ** 2)
    assert not any("steps" in line for line in lines(site))  # the slope is steep, but without steps


def test_a_model_in_a_laboratory(site):
    """A slope with cells of 5 cm, at coordinates that might be degrees, gives no warning."""
    site.dem(site.z / 100, crs=None, transform=Affine(0.05, 0, 0.0, 0, -0.05, 4.0))
    site.uniform(0.005)
    site.set("boulder", volume_mean=1e-6)
    site.set("release", x=[1.5], y=[3.5], drop_height=0.1)
    assert lines(site) == []


CASES = [
    one
    for one in (ROOT / "cases").glob("*/*.nml")
    if "&terrain" in one.read_text() and not (one.parent / "make_case.py").exists()
]


def tutorial_layers(folder):
    maker = ROOT / "cases/tutorial/make_layers.py"
    subprocess.run([sys.executable, maker, folder], check=True)


@pytest.mark.all
@pytest.mark.parametrize("case", sorted(CASES), ids=lambda case: str(case.relative_to(ROOT)))
def test_cases(case, gallery, tmp_path):
    """Shipped cases give no warning. Terrain that is not stored is made first, by the case or by
    the tutorial."""
    folder = shutil.copytree(case.parent, tmp_path / "case")
    if not list(folder.glob("dem.*")):
        maker = folder / "make_terrain.py"
        if maker.exists():
            subprocess.run([sys.executable, maker, folder], check=True)
        else:  # layers made by another case
            gallery.copy("tutorial", tutorial_layers, folder)
    given = rockfall.read_case(folder / case.name)
    for one in rockfall.variants(given).values() if given.variant else [given]:
        assert implausible(read_scene(one)) == []


# ---- what `rockfall check` prints


def test_check_tells_elevations_slopes_and_speed(site):
    steep = math.tan(math.radians(35))
    y = np.mgrid[NY - 1 : -1 : -1, 0:NX][0] * CELL  # 0 at the centres of the lowest cells
    site.dem(1000.0 + steep * y)
    site.set("release", drop_height=10.0, velocity=[3.0, 0.0, 4.0])
    page = preview(read_scene(site.case()))
    rows = {line[2:15].strip(): line[15:] for line in page.splitlines()[1:]}
    source = (NY - 0.5) * CELL - 50.0  # as y counts; on the edge of two cells
    low, high, *sources = (float(word.replace(",", "")) for word in numbers(rows["elevations"]))
    assert (low, high) == pytest.approx((1000.0, 1000.0 + steep * (NY - 1) * CELL), abs=0.05)
    assert sources == pytest.approx([1000.0 + steep * source], abs=steep * CELL / 2 + 0.05)
    assert rows["slopes"] == "median 35 degrees; sources: median 35 degrees"
    speed = math.sqrt(25 + 2 * 9.81 * (10.0 + steep * source))
    assert rows["speed"].startswith(f"at most {speed:.0f} m/s")
    assert "mass 2,240 kg" in rows["sizes"] and "R_b 0.576 m" in rows["sizes"]
    zones = [line.strip() for line in page.splitlines() if line.strip().startswith("zone ")]
    assert [line.split(";")[0] for line in zones] == [
        "zone 1: R_m 0.3 m, R_b/R_m 1.92", "zone 2: R_m 0.2 m, R_b/R_m 2.88", "zone 3: absorbs"
    ]  # fmt: skip


def numbers(text):
    return re.findall(r"-?[\d,]+\.\d", text)
