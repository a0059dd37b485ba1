# SPDX-License-Identifier: BSD-3-Clause
"""Layers given as GeoDataFrames are equivalent to files: equal scenes, equal refusals."""

import os

import numpy as np
import pandas as pd
import pytest

import rockfall
from made import make_frame, make_layer, refused
from programs import make_full_case
from rockfall.result.crossings import line_names
from rockfall.scene.read import read_scene

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

W, N = 600000.0, 5000000.0


def across(y, x=0.0):
    return shapely.LineString([(W + x, N - y), (W + 300 - x, N - y)])


CLIFF = shapely.box(W + 60, N - 60, W + 120, N - 40)
LAYERS = {
    "lines": ([across(131), across(151)], {"name": ["B 12", None]}),
    "barriers": ([across(90)], {"height": [4.0], "class": pd.array([3], "Int64")}),
    "dams": ([across(141, 10)], {"height": [2], "allow_coarse": [True]}),
    "sources": ([CLIFF], {}),
    "trees": ([shapely.Point(W + 90, N - 100)], {"dbh": [30.0], "species": ["spruce"]}),
}


@pytest.fixture
def case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return make_full_case(tmp_path, case={"boulders": 5}).replace(line=[])


@pytest.mark.all
def test_frames_give_the_bits_of_files(case):
    case = case.replace(forest=dict.fromkeys(case.forest, None))
    for name, (shapes, columns) in LAYERS.items():
        plain = {key: [*column] for key, column in columns.items()}
        make_layer(f"{name}.gpkg", shapes, **plain)
    files = case.replace(
        line=[{"file": "lines.gpkg"}],
        barrier=[{"file": "barriers.gpkg"}],
        dam=[{"file": "dams.gpkg"}],
        release={"x": None, "y": None, "cells": None, "polygons": "sources.gpkg"},
        forest={"trees": "trees.gpkg"},
    )
    frames = {name: make_frame(shapes, **columns) for name, (shapes, columns) in LAYERS.items()}
    one, other = rockfall.run(files), rockfall.run(case, **frames)
    assert line_names(one) == line_names(other)
    for name, values in one.data_vars.items():
        np.testing.assert_array_equal(values, other[name])
    again = rockfall.run(case, **frames)
    assert again.attrs["input_checksums"] == other.attrs["input_checksums"]
    assert not [key for key in other.attrs if ".fgb" in str(other.attrs[key])]
    assert "polygons = '(array)'" in other.attrs["case"] and not os.path.exists("(array)")


def test_points_of_a_frame_are_those_of_a_layer(case):
    points, about = [shapely.Point(W + x, N - 20) for x in (120, 180)], {"name": ["left", None]}
    make_layer("points.gpkg", points, **about)
    files = case.replace(release={"x": None, "y": None, "cells": None, "points": "points.gpkg"})
    one, other = read_scene(files), read_scene(case, sources=make_frame(points, **about))
    assert one.x.tolist() == other.x.tolist() == [W + 120, W + 180]
    assert one.features.names == other.features.names == ["left", "2"]


def test_zones_of_a_frame_take_the_place_of_a_raster(case):
    halves = [shapely.box(W, N - 200, W + 150, N), shapely.box(W + 150, N - 200, W + 900, N)]
    zones = make_frame(halves, zone=pd.array([-2, 77], "Int64"))
    scene = read_scene(case.replace(surface={"default_zone": 4}), zones=zones)
    zone = scene.rasters.zone
    for cells, row in (zone[:40, :30], 2), (zone[:40, 30:], 3), (zone[40:], 1):
        assert (cells == row).all()
    assert scene.case.surface["zones"] == "(array)"


def test_objects_of_a_frame_are_those_of_a_layer(case):
    case = case.replace(
        scenario=[{"name": "all", "return_period": 10.0}], output={"trajectories": 0}
    )
    shapes, names = [across(151), CLIFF], ["road", "cliff"]
    make_layer("objects.gpkg", shapes, name=names)
    one = rockfall.hazard(case, objects="objects.gpkg")
    other = rockfall.hazard(case, objects=make_frame(shapes, name=names))
    assert one["object_passages"].values.any()
    for name in one.data_vars:
        np.testing.assert_array_equal(one[name], other[name])


def test_what_cannot_be_is_said_of_the_frame(case):
    with refused("lines = (GeoDataFrame): feature 1: is a Point, but lines are required"):
        read_scene(case, lines=make_frame([shapely.Point(W, N)]))
    with refused("lines: the GeoDataFrame is empty"):
        read_scene(case, lines=make_frame([]))
    with refused(
        "roads: unknown layer: must be one of lines, barriers, dams, zones, trees, stands, "
        "clearings, sources"
    ):
        read_scene(case, roads=make_frame([across(9)]))
    with pytest.raises(rockfall.RockfallError, match=r"^lines: cannot be read as a GeoDataFrame"):
        read_scene(case, lines=make_frame(["LINESTRING (0 0, 1 1)"]))
    with pytest.raises(rockfall.RockfallError, match=r"^sources: must be Polygons"):
        read_scene(case, sources=make_frame([across(9)]))
