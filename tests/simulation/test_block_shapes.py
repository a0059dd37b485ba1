# SPDX-License-Identifier: BSD-3-Clause
"""Boulders with several block shapes in one run: each is bit-identical to a run with its shape
alone, in both programs and however the run is divided. Fractions are met; invalid input is
refused."""

import re

import netCDF4
import numpy as np
import pytest
from rockfall._core import rockfall_f2py as _core

import rockfall
from made import every_third, make_layer, make_raster, refused
from programs import (
    Killed,
    killed_after,
    make_full_case,
    refused_in_one_line,
    run_program,
    same_results,
)
from rockfall.case.variants import variants as case_variants
from rockfall.cli import main
from rockfall.grounds.impact_tables import BLOCK_SHAPES, plane_files
from rockfall.html_report.inputs import Parties, input_table
from rockfall.result.crossings import at_lines
from rockfall.result.dataset import put_netcdf
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible
from rockfall.simulation.parts import checkpoint
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_scene
from rockfall.studies.ensemble.uncertain_inputs import Uncertain, drawn_scene
from rockfall.studies.model_scenes import variants
from same import same, same_bits
from scenes import case_in, grid, place, rough

SHARES = [0.5, 0.3, 0.2]
MIX = {"volume": "lognormal", "volume_mean": 0.6, "volume_std": 0.4}
MIX |= {"block_shape": [*BLOCK_SHAPES], "block_shape_share": SHARES}
SHAPES_OF_MIX = ("block_shape", "block_shape_share")
ZONES = "zone,mean_radius,ground\n1,,talus\n2,0.3,rocky-slope\n3,0.3,\n4,,own.nc\n"
#: Row variables, without sums over all boulders and maps, which differ between parts of a run.
ROWS = ("volume", "stop_x", "stop_y", "stop_z", "path_length", "travel_time", "speed_max",
        "jump_height_max", "status", "impacts", "line_speed", "line_passing_height")  # fmt: skip


def row_of(result, name):
    """Values of each boulder, in the result or at its lines."""
    return (at_lines(result) if name.startswith("line_") else result)[name].values


def terrain():
    z = rough()
    return {"dem": z, "transform": grid(z)}


def striped():
    """Terrain with zones in stripes from west to east, of which boulders cross several."""
    zones = np.repeat(np.arange(80)[:, None] // 7 % 4 + 1, 60, axis=1).astype("i4")
    return terrain() | {"zones": zones}


def same_by_the_program(case, result, folder):
    """Output of rockfall-batch for a case; its result must be bit-identical to `result`."""
    prepare(case, folder)
    done = run_program("case.nml", "-o", "out.nc", cwd=folder)
    assert done.returncode == 0, done.stderr
    same_results(rockfall.merge([folder / "out.nc"]), result)
    return done.stdout


def mixed_case(folder, boulder=MIX, **groups):
    """Case with tables for one shape, for all shapes, and from a file, and with impact sets."""
    (folder / "zones.csv").write_text(ZONES)
    rows = [*plane_files("hard", "platy").values()]
    (folder / "own.nc").write_bytes(rows[0].read_bytes())
    surface = {"zones": "(array)", "table": "zones.csv"}
    return case_in(folder, surface=surface, boulder=boulder, **{**place(), **groups})


@pytest.fixture(scope="module")
def mixed(gallery):
    return gallery.value("mixed", made_of_mix)


def made_of_mix(folder):
    case = mixed_case(folder)
    return case, rockfall.run(case, **striped())


def write_parts(folder):
    case = mixed_case(folder)
    for k in (1, 2):
        name = folder / f"{k}.nc"
        put_netcdf(rockfall.run(case, shard=(k, 2), **striped()), name, name)


def test_each_boulder_goes_as_in_a_run_of_its_shape(mixed):
    case, result = mixed
    shape = result["block_shape"].values
    alone = {
        name: rockfall.run(
            case.replace(boulder={"block_shape": [name], "block_shape_share": None}), **striped()
        )
        for name in BLOCK_SHAPES
    }
    for number, one in enumerate(alone.values(), start=1):
        own = shape == number
        assert own.sum() > 30 and "block_shape" not in one
        for name in ROWS:
            values, others = row_of(result, name)[..., own], row_of(one, name)[..., own]
            assert same_bits(values, others), (number, name)
    stops = [one["stop_y"].values for one in alone.values()]
    assert (stops[0] != stops[1]).mean() > 0.5  # shapes matter here
    # totals over all boulders are the sum over shapes
    for name in ("passages", "deposits"):
        assert result[name].values.sum() < sum(one[name].values.sum() for one in alone.values())
    assert int(result["rebounds"]) == int(result["rebounds_by_ground"].sum())
    assert result["ground"].values.tolist() == alone["platy"]["ground"].values.tolist()


@pytest.mark.all
def test_the_order_of_the_shapes_and_the_unit_share_do_not_matter(mixed):
    case, result = mixed
    turned = {"block_shape": BLOCK_SHAPES[::-1], "block_shape_share": SHARES[::-1]}
    other = rockfall.run(case.replace(boulder=turned), **striped())
    assert same_bits(result["stop_y"], other["stop_y"])
    one = {"block_shape": ["elongated", "platy"], "block_shape_share": [0.0, 1.0]}
    one, alone = (
        rockfall.run(case.replace(boulder=boulder), **striped())
        for boulder in (one, {"block_shape": "platy", "block_shape_share": None})
    )
    assert "block_shape" not in one and same_bits(one["stop_y"], alone["stop_y"])


def test_shares_are_met():
    """Fractions of shapes are met within four standard errors, and shapes are independent of
    volumes."""
    case = rockfall.Case(
        case={"boulders": 4000, "seed": 5}, impact={"table": "talus", "impact_limit": 1},
        boulder={**MIX, "block_shape_share": None},
        release={"x": [150.0, 90.0], "y": [380.0, 300.0], "drop_height": 2.0},
    )  # fmt: skip
    for shares in (None, SHARES, [0.333, 0.333, 0.333], [0.02, 0.0, 0.98]):
        result = rockfall.run(case.replace(boulder={"block_shape_share": shares}), **terrain())
        n = result.sizes["boulder"]
        for k, share in enumerate(shares or [1 / 3] * 3, start=1):
            error = np.sqrt(share * (1 - share) / n)
            part = (result["block_shape"].values == k).mean()
            assert abs(part - share) < 4 * error + 0.0004, (shares, k)
    shape, volume = result["block_shape"].values, result["volume"].values
    assert abs(np.corrcoef(shape, volume)[0, 1]) < 4 / np.sqrt(n)  # independent draws


def test_the_result_names_the_shapes(mixed, tmp_path):
    _, result = mixed
    rockfall.write_result(result, tmp_path / "out.nc")
    shape = rockfall.read_result(tmp_path / "out.nc")["block_shape"]
    assert shape.dims == ("boulder",) and shape.attrs["units"] == "1"
    assert shape.attrs["flag_values"].tolist() == [1, 2, 3]
    assert shape.attrs["flag_meanings"].split() == [*BLOCK_SHAPES]
    assert shape.attrs["flag_values"].dtype == shape.dtype


@pytest.mark.family(2)
@pytest.mark.parametrize("lanes", every_third([0, 1, 2, 3]))
def test_no_bit_depends_on_lanes(mixed, lanes):
    case, result = mixed
    scene = read_scene(case, **striped())
    _core.carry_in_lanes(scene.kernel.handle, lanes)
    same(run_scene(scene), result)


@pytest.mark.all
def test_threads_chunks_and_parts_change_nothing(mixed):
    case, result = mixed
    same(rockfall.run(case, threads=3, chunk=17, **striped()), result)
    parts = [rockfall.run(case, shard=(k, 3), **striped()) for k in (1, 2, 3)]
    same(rockfall.merge(parts), result)


def full_case(folder, **boulder):
    """Case in files for both programs, with tables for its zones."""
    case = make_full_case(
        folder, impact={"table": "talus", "sets": None}, boulder={**MIX, **boulder},
        case={"boulders": 15},
    )  # fmt: skip
    (folder / "zones.csv").write_text("zone,mean_radius,ground\n4,,\n-2,0.5,rocky-slope\n77,inf,\n")
    return case


@pytest.mark.all
def test_both_programs_give_the_same_and_join(tmp_path):
    case = full_case(tmp_path)
    whole = rockfall.run(case)
    printed = same_by_the_program(case, whole, tmp_path / "ready")
    assert printed.count("ground talus: ") == 1  # whatever the shapes
    run_program("case.nml", "--shard", "1/2", "-o", "1.nc", cwd=tmp_path / "ready")
    rest = rockfall.run(case, shard=(2, 2))
    same_results(rockfall.merge([tmp_path / "ready" / "1.nc", rest]), whole)


@pytest.mark.all
def test_terrain_in_windows_gives_the_same(tmp_path):
    case = full_case(tmp_path).replace(output={"maps": ["passages"]})
    windowed = read_scene(case, memory=4 * 8 * 60 * 30)
    assert windowed.windows
    one, other = run_scene(windowed), rockfall.run(case)
    for name in (*ROWS, "block_shape"):
        assert same_bits(row_of(one, name), row_of(other, name)), name


@pytest.mark.all
def test_fragments_have_the_shape_of_their_boulder(tmp_path):
    case = full_case(tmp_path, block_shape=["platy", "elongated"], block_shape_share=None)
    case = case.replace(
        case={"boulders": 5}, breakage={"at": "impact", "min_area_ratio": 0.3},
        output={"maps": None},
    )  # fmt: skip
    result = rockfall.run(case)
    assert {*np.unique(result["block_shape"])} == {2, 3} and (result["fragments"] > 1).sum() > 5
    alone = rockfall.run(case.replace(boulder={"block_shape": "platy", "block_shape_share": None}))
    own = result["block_shape"].values == 3
    for name in (*ROWS, "fragments", "fines_volume"):
        assert same_bits(row_of(result, name)[..., own], row_of(alone, name)[..., own]), name


# ---- shapes given by source layers and tables

NAMES = "name,x,y,block_shape,a,b,c\n"
ROWS_OF_SOURCES = (
    "1,150,380,platy,,,\n2,120,380,,,,\n3,90,380,,1.0,0.65,0.6\n4,90,300,,3.0,2.6,2.5\n"
)


def by_sources(folder, rows=NAMES + ROWS_OF_SOURCES, **groups):
    (folder / "sources.csv").write_text(rows)
    release = {"points": "sources.csv", "drop_height": 5.0}
    impact = {"table": "talus", "sets": None}
    groups = {"boulder": {"volume": "fixed", "volume_mean": 0.6}, **groups}
    return case_in(folder, release=release, impact=impact, **groups)


def test_sources_say_the_shape_of_their_boulders(tmp_path):
    """Sources have a shape by name or by measured axes; others have that of the case."""
    shapes = [3, 1, 2, 1]
    case = by_sources(tmp_path)
    result = rockfall.run(case, **terrain())
    assert np.array_equal(result["block_shape"], np.array(shapes)[result["source"].values - 1])
    alone = {
        k: rockfall.run(
            by_sources(
                tmp_path,
                re.sub(",[^,]*,[^,]*,[^,]*,[^,]*$", "", NAMES + ROWS_OF_SOURCES, flags=re.M),
                boulder={"volume": "fixed", "volume_mean": 0.6, "block_shape": shape},
            ),
            **terrain(),
        )
        for k, shape in enumerate(BLOCK_SHAPES, start=1)
    }
    for k, one in alone.items():
        own = result["block_shape"].values == k
        for name in ROWS:
            assert same_bits(row_of(result, name)[..., own], row_of(one, name)[..., own]), (k, name)


def test_sources_without_a_shape_have_those_of_the_mix(tmp_path):
    case = by_sources(tmp_path, boulder=MIX)
    result = rockfall.run(case, **terrain())
    shape, source = result["block_shape"].values, result["source"].values
    assert [{*shape[source == k].tolist()} for k in (1, 2, 3, 4)] == [{3}, {1, 2, 3}, {2}, {1}]
    everywhere = rockfall.run(case_in(tmp_path, impact=case.impact, boulder=MIX, **place(120.0)),
                              **terrain())  # fmt: skip
    assert everywhere["block_shape"].values.mean() == pytest.approx(1.7, abs=0.2)


@pytest.mark.all
def test_shapes_of_polygons_hold_for_their_cells_in_both_programs(tmp_path):
    import shapely

    west, north = 600000.0, 5000000.0
    boxes = [shapely.box(west + x, north - 60, west + x + 40, north - 20) for x in (80, 130, 180)]
    make_layer(tmp_path / "cliffs.gpkg", boxes, crs="EPSG:32632", block_shape=["platy", None, None],
               a=[None, 2.0, None], b=[None, 1.1, None], c=[None, 1.0, None])  # fmt: skip
    case = full_case(tmp_path).replace(
        case={"boulders": 3}, release={"x": None, "y": None, "polygons": "cliffs.gpkg"}
    )
    result = rockfall.run(case)
    shape, feature = result["block_shape"].values, result["source_feature"].values
    assert [{*shape[feature == k].tolist()} for k in (1, 2, 3)] == [{3}, {2}, {1, 2, 3}]
    same_by_the_program(case, result, tmp_path / "ready")


@pytest.mark.parametrize(
    "axes, shape",
    [((1, 0.9, 0.8), 1), ((1, 0.62, 0.56), 2), ((1, 0.8, 0.42), 3), ((1, 1, 1), 1),
     ((2, 2, 0.5), 3), ((3, 1, 1), 2), ((30, 27, 24), 1), ((0.5, 0.31, 0.1), 3),
     ((1, 0.77, 0.7), 1), ((1, 0.75, 0.68), 2)],
)  # fmt: skip
def test_axes_have_the_nearest_shape(axes, shape):
    """Axes have the shape that is nearest in (b/a, c/b): compact (0.9, 0.89), elongated (0.62,
    0.90), platy (0.8, 0.525)."""
    assert _core.shapes_of_axes(np.array([axes], float).T).tolist() == [shape]


@pytest.mark.parametrize(
    "row, message",
    [
        ("flat,,,", "block_shape = 'flat': must be one of: compact, elongated, platy"),
        ("3,,,", "block_shape = '3': must be one of: compact, elongated, platy"),
        ("platy,1.0,0.8,0.4", "block_shape = 'platy': give this or the axes a, b, c"),
        (",1.0,0.8,", "c = '': is missing: a block requires the axes a, b and c"),
        (",,,0.4", "a = '': is missing: a block requires the axes a, b and c"),
        (",1.0,0.8,0", "c = 0.0: must be > 0"),
        (",1.0,-0.8,-0.9", "b = -0.8: must be > 0"),
        (",inf,0.8,0.4", "a = .*: must be .*"),
        (",0.8,1.0,0.4", "a = 0.8: must be a >= b >= c"),
        (",1.0,0.4,0.8", "b = 0.4: must be a >= b >= c"),
        (",long,0.4,0.8", "a = 'long': must be a number"),
    ],
)
def test_shapes_and_axes_that_cannot_be_are_refused(tmp_path, row, message):
    rows = f"{NAMES}1,150,380,,,,\n2,120,380,{row}\n"
    with pytest.raises(rockfall.RockfallError, match=f"sources.csv: line 3: {message}$") as caught:
        rockfall.run(by_sources(tmp_path, rows), **terrain())
    assert "\n" not in str(caught.value)


def test_lone_columns_named_like_axes_are_other_attributes(tmp_path):
    rows = "x,y,a,b\n150,380,7,x\n"
    assert "block_shape" not in rockfall.run(by_sources(tmp_path, rows), **terrain())


def test_shapes_of_sources_without_a_table_are_reported(tmp_path):
    case = by_sources(tmp_path).replace(impact={"form": "matrix"})
    scene = read_scene(case, **terrain())
    (text,) = (text for text in scene.remarks if "block_shape" in text)
    assert "sources.csv" in text and len(text.split()) <= 25
    assert "block_shape" not in run_scene(scene)


# ---- keys


SHAPE, SHARE = "block_shape", "block_shape_share"
#: Values, the refused key, and the end of the message.
WRONG_MIXES = [
    ({SHAPE: ["compact", "round"]}, SHAPE, "(value 2) = 'round': must be one of: "),
    ({SHAPE: ["platy", "platy"]}, SHAPE, "= 'platy', 'platy': must list each shape once"),
    ({SHAPE: [*BLOCK_SHAPES, "compact"]}, SHAPE,
        "= 'compact', 'elongated', 'platy', 'compact': must list each shape once"),
    ({SHARE: [0.5, 0.5]}, SHARE, "= 0.5, 0.5: must have 3 values, one for each block_shape"),
    ({SHARE: [0.5, 0.3, 0.3]}, SHARE, "= 0.5, 0.3, 0.3: must sum to 1, but sums to 1.1"),
    ({SHARE: [0.3, 0.3, 0.3]}, SHARE, "= 0.3, 0.3, 0.3: must sum to 1, but sums to 0.9"),
    ({SHARE: [0.0, 0.0, 0.0]}, SHARE, "= 0.0, 0.0, 0.0: must sum to 1, but sums to 0"),
    ({SHARE: [0.5, -0.3, 0.8]}, SHARE, "(value 2) = -0.3: must be 0 to 1"),
    ({SHARE: [0.5, 0.5, float("nan")]}, SHARE, "(value 3) = nan: must be a finite real number"),
    ({SHARE: [50.0, 30.0, 20.0]}, SHARE, "(value 1) = 50.0: must be 0 to 1"),
    ({SHAPE: "platy"}, SHARE, "= 0.5, 0.3, 0.2: must have 1 values, one for each block_shape"),
    ({SHAPE: "platy", SHARE: 0.5}, SHARE, "= 0.5: must sum to 1, but sums to 0.5"),
]  # fmt: skip


@pytest.mark.parametrize("keys, key, message", WRONG_MIXES)
def test_mixes_that_cannot_be_are_refused(tmp_path, keys, key, message):
    with pytest.raises(rockfall.RockfallError) as caught:
        case_in(tmp_path, impact={"table": "talus", "sets": None}, boulder=MIX | keys, **place())
    text = str(caught.value)
    assert text.startswith(f"case: &boulder {key} {message}")
    assert "\n" not in text and len(text.split()) <= 25


def test_a_mix_on_grounds_without_a_table_is_refused(tmp_path):
    (tmp_path / "zones.csv").write_text("zone,ground\n1,soft-soil\n2,\n")
    case = mixed_case(tmp_path).replace(impact={"sets": "laboratory-spheres"})
    (tmp_path / "zones.csv").write_text("zone,mean_radius,ground\n" + "".join(
        f"{k},0.3,\n" for k in (1, 2, 3, 4)))  # fmt: skip
    with refused("case: &boulder block_shape = 'compact', 'elongated', 'platy': is only valid "
                 "with an impact table, which no ground has"):  # fmt: skip
        read_scene(case, **striped())


def test_only_tables_that_boulders_need_are_loaded(tmp_path):
    """Tables of two shapes take less memory than those of three. If every source has a shape, only
    its tables are loaded."""

    def bytes_of(case):
        return read_scene(case, **terrain()).kernel.arrays()["table_record"].nbytes

    one, two, three = (
        bytes_of(by_sources(tmp_path, "x,y\n150,380\n", boulder={**MIX, **keys}))
        for keys in (
            {"block_shape": "platy", "block_shape_share": None},
            {"block_shape": ["platy", "elongated", "compact"], "block_shape_share": [0.5, 0.5, 0]},
            {},
        )
    )
    assert 1.5 * one < two < three
    assert bytes_of(by_sources(tmp_path, "x,y,block_shape\n150,380,platy\n", boulder=MIX)) == one


# ---- axes of listed volumes, and sides in rasters

LISTED = {"volume": "list", "volumes": [0.1, 0.6, 0.6, 1.4], "volume_mean": None}
AXES = [0.6, 0.5, 0.4, 1.4, 0.9, 0.8, 1.3, 1.1, 0.5, 1.6, 1.0, 0.9]
LISTED_SHAPES = np.array([1, 2, 3, 2])


@pytest.mark.all
def test_listed_volumes_have_the_shape_of_their_axes(tmp_path):
    """Listed volumes have shapes by their axes, also two equal volumes with different axes."""
    case = full_case(tmp_path, **dict.fromkeys([*MIX, "volume_std"]) | LISTED, block_axes=AXES)
    result = rockfall.run(case)
    shape, volume = result["block_shape"].values, result["volume"].values
    assert {*zip(volume.tolist(), shape.tolist(), strict=True)} == {
        *zip(LISTED["volumes"], LISTED_SHAPES.tolist(), strict=True)
    }
    for k in (1, 2, 3):
        alone = rockfall.run(
            case.replace(boulder={"block_axes": None, "block_shape": BLOCK_SHAPES[k - 1]})
        )
        own = shape == k
        for name in ROWS:
            assert same_bits(row_of(result, name)[..., own], row_of(alone, name)[..., own]), (
                k,
                name,
            )
    same_by_the_program(case, result, tmp_path / "ready")


@pytest.mark.parametrize(
    "keys, message",
    [
        ({"block_axes": AXES[:9]}, "block_axes = .*: must have three values for each value of "
                                   "volumes"),
        ({"block_axes": AXES[:-1]}, "block_axes = .*: must have three values for each value of "
                                    "volumes"),
        ({"block_axes": [*AXES[:9], 1.0, 1.6, 0.9]},
         r"block_axes \(value 10\) = 1.0: must be a, b, c of each block, with a >= b >= c"),
        ({"block_axes": [*AXES[:9], 1.6, 0.9, 1.0]}, r"block_axes \(value 10\) = 1.6: must be a,"),
        ({"block_axes": [0.0, *AXES[1:]]}, r"block_axes \(value 1\) = 0.0: must be > 0"),
        ({"block_axes": [*AXES[:11], -0.9]}, r"block_axes \(value 12\) = -0.9: must be > 0"),
        ({"block_shape": ["compact", "platy"]},
         "block_shape = .*: is not valid together with block_axes"),
        ({"volume": "fixed", "volume_mean": 1.0, "volumes": None},
         "block_axes = .*: is not valid for volume = 'fixed'"),
        ({"block_axes": None, "block_shape": "source"},
         "block_shape = 'source': 'source' requires a layer or table of sources, or the rasters "
         "d1"),
        ({"block_axes": None, "block_shape": ["source", "platy"]},
         "block_shape = 'source', 'platy': 'source' cannot be combined with other shapes"),
    ],
)  # fmt: skip
def test_axes_of_lists_that_cannot_be_are_refused(tmp_path, keys, message):
    boulder = LISTED | {"block_axes": AXES} | keys
    with pytest.raises(rockfall.RockfallError, match=f"^case: &boulder {message}") as caught:
        case_in(tmp_path, impact={"table": "talus", "sets": None}, boulder=boulder, **place())
    assert "\n" not in str(caught.value) and len(str(caught.value).split()) <= 25


def by_sides(folder, **boulder):
    """Case with four sources whose rasters give the sides of boulders, in any order."""
    sides = {"d1": [1.0, 0.5, 0.9, 1.0], "d2": [1.0, 1.0, 1.6, 0.4], "d3": [0.9, 0.55, 1.5, 1.0]}
    for name, values in sides.items():
        raster = np.ones((80, 60))
        raster[76, [20, 24, 30, 36]] = values
        make_raster(folder / f"{name}.tif", raster, crs="EPSG:32632")
    cells = np.zeros((80, 60), "i2")
    cells[76, [20, 24, 30, 36]] = 1
    make_raster(folder / "cells.tif", cells, crs="EPSG:32632")
    boulder = {"volume": "source", "d1": "d1.tif", "d2": "d2.tif", "d3": "d3.tif", **boulder}
    case = full_case(folder, **dict.fromkeys(SHAPES_OF_MIX))
    boulder |= dict.fromkeys(("volume_mean", "volume_std"))
    release = {"x": None, "y": None, "cells": "cells.tif"}
    return case.replace(boulder=boulder, release=release)


@pytest.mark.all
def test_sides_in_rasters_give_the_shape_where_the_case_asks_for_it(tmp_path):
    case = by_sides(tmp_path, block_shape="source")
    result = rockfall.run(case)
    expected = np.array([1, 2, 3, 3])  # 1.6 : 1.5 : 0.9 is nearest to platy by c/b = 0.6
    assert np.array_equal(result["block_shape"], expected[result["source"].values - 1])
    same_by_the_program(case, result, tmp_path / "ready")
    scene = read_scene(by_sides(tmp_path))
    assert "block_shape" not in run_scene(scene)  # unchanged, except for a remark
    (text,) = (text for text in scene.remarks if "block_shape" in text)
    assert text.startswith("&boulder block_shape: 3 of 4 sources") and len(text.split()) <= 25


def test_sources_must_all_give_their_shape_where_the_case_has_none(tmp_path):
    boulder = {"volume": "fixed", "volume_mean": 0.6, "block_shape": "source"}
    with pytest.raises(rockfall.RockfallError, match="sources.csv: line 3: has no block_shape and"):
        rockfall.run(by_sources(tmp_path, boulder=boulder), **terrain())
    rows = NAMES + ROWS_OF_SOURCES.replace("2,120,380,,,,", "2,120,380,elongated,,,")
    result = rockfall.run(by_sources(tmp_path, rows, boulder=boulder), **terrain())
    assert np.array_equal(result["block_shape"], np.array([3, 2, 2, 1])[result["source"] - 1])


# ---- output of shapes


@pytest.mark.all
def test_numbers_at_lines_split_by_shape(mixed, tmp_path, capsys):
    _, result = mixed
    table = rockfall.line_statistics(result, by="shape", quantities=["speed"])
    shape, speed = result["block_shape"].values, at_lines(result)["line_speed"].values[0]
    assert table["shape"].tolist() == [*BLOCK_SHAPES]
    for k, row in enumerate(table.to_dict("records"), start=1):
        own = speed[shape == k]
        assert row["boulders"] == own.size and row["n"] == np.isfinite(own).sum() > 0
        assert row["mean"] == pytest.approx(np.nanmean(own))
    rockfall.write_result(result, tmp_path / "out.nc")
    assert main(["lines", str(tmp_path / "out.nc"), "--by", "shape"]) == 0
    assert all(f"\n  {name} " in capsys.readouterr().out for name in BLOCK_SHAPES[:1])
    with refused("by = 'shape': all boulders of the result have the same block shape"):
        rockfall.line_statistics(result.drop_vars("block_shape"), by="shape")


@pytest.mark.all
def test_check_and_the_report_have_the_fractions(tmp_path, capsys):
    case = full_case(tmp_path)
    assert main(["check", case.name]) == 0
    (line,) = re.findall("^  shapes +(.*)$", capsys.readouterr().out, re.M)
    parts = [float(part) for part in re.findall(r"([0-9.]+) %", line)]
    assert [part.split()[-1] for part in line.split(", ")] == [*BLOCK_SHAPES]
    assert sum(parts) == pytest.approx(100, abs=0.2)
    result = rockfall.run(case)
    (row,) = (row for row in input_table(result, Parties()).rows if row[0] == "block shape")
    part = (result["block_shape"].values == 3).mean()
    assert row[1].endswith(f"{100 * part:.1f} % platy") or f"{100 * part:.0f} % platy" in row[1]


def test_exported_tables_name_the_shapes(mixed, tmp_path):
    _, result = mixed
    rockfall.export(result, tmp_path / "out", formats=["csv"])
    rows = (tmp_path / "out" / "boulders.csv").read_text().splitlines()
    column = rows[0].split(",").index("block_shape")
    words = [row.split(",")[column] for row in rows[1:]]
    assert words == [BLOCK_SHAPES[k - 1] for k in result["block_shape"].values]


# ---- studies of a mix


def test_each_draw_of_an_ensemble_has_the_table_of_each_shape(tmp_path):
    case = case_in(
        tmp_path, impact={"table": "talus", "sets": None}, output={"maps": None}, boulder=MIX,
        ensemble={"sets": ["talus-ensemble"], "runs": 8}, case={"boulders": 60}, **place(),
    )  # fmt: skip
    mixed, alone = (
        run_scene(drawn_scene(scene, [Uncertain(scene)._set(3)], 5))
        for scene in (
            read_scene(case.replace(boulder=keys), **terrain())
            for keys in ({}, {"block_shape": "platy", "block_shape_share": None})
        )
    )
    own = mixed["block_shape"].values == 3
    assert own.sum() > 3 and same_bits(mixed["stop_x"].values[own], alone["stop_x"].values[own])
    usual = rockfall.run(case.replace(case={"seed": 5}), **terrain())
    assert not np.array_equal(usual["stop_x"], mixed["stop_x"])


def test_models_run_a_mix_by_impact_sets_too(tmp_path):
    case = make_full_case(tmp_path, impact={"form": "table", "table": "talus"}, boulder=MIX)
    case = case.replace(output={"maps": None}, case={"boulders": 20})
    found = dict(variants(case, [], []))
    assert {"table talus", "impact sets, method B"} <= found.keys()
    assert {*run_scene(found["table talus"])["block_shape"].values.tolist()} == {1, 2, 3}


@pytest.mark.all
def test_a_session_follows_changes_of_the_shapes(tmp_path):
    case = full_case(tmp_path).replace(output={"maps": None})
    with rockfall.open(case) as session:
        for keys in ({}, {"block_shape": "platy", "block_shape_share": None}, MIX):
            session.change(boulder=keys)
            result = [*session.run()][-1].dataset()
            assert same_bits(result["stop_y"], rockfall.run(case.replace(boulder=keys))["stop_y"])
            assert ("block_shape" in result) == (len(keys) != 2)


def test_variants_differ_by_shape(tmp_path):
    case = full_case(tmp_path).replace(output={"maps": None}, variant=[
        {"name": "mix"},
        {"name": "plates", "boulder_block_shape": ["platy"], "boulder_block_shape_share": [1.0]},
    ])  # fmt: skip
    mixed, plates = (rockfall.run(one) for one in case_variants(case).values())
    own = mixed["block_shape"].values == 3
    assert "block_shape" not in plates
    assert same_bits(mixed["stop_y"].values[own], plates["stop_y"].values[own])


@pytest.mark.parametrize("table, says", [("rocky-slope", True), ("talus", False)])
@pytest.mark.parametrize("keys", [{}, {"block_shape": "platy", "block_shape_share": None}])
def test_shapes_are_doubted_where_one_table_is_for_all(tmp_path, table, says, keys):
    case = case_in(tmp_path, impact={"table": table, "sets": None}, boulder=MIX | keys, **place())
    texts = [text for text in implausible(read_scene(case, **terrain())) if "block_shape" in text]
    assert texts == ["case: &boulder block_shape: has no effect: each ground (rocky-slope) has "
                     "a single impact table for all shapes"] * says  # fmt: skip


# ---- files: checkpoints resume, and inconsistent files are refused


@pytest.mark.all
def test_a_run_that_was_killed_goes_on(mixed, tmp_path, monkeypatch):
    case, result = mixed
    scene = read_scene(case, **striped())
    monkeypatch.setattr(checkpoint, "REST", 0.0)
    for _ in range(2):
        with monkeypatch.context() as patch:
            killed_after(patch, 3)
            with pytest.raises(Killed):
                run_scene(scene, chunk=40, checkpoint=Checkpoint(tmp_path / "c", 0.0))
    same(run_scene(scene, chunk=90, checkpoint=Checkpoint(tmp_path / "c", 0.0)), result)


def without_attribute(file):
    file.delncattr("block_shapes")


def with_shape(number):
    def change(file):
        file["block_shape"][3] = number

    return change


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "change, message",
    [
        (with_shape(4), "2.nc: is damaged: block_shape = 4: must be 1 to 3"),
        (with_shape(0), "2.nc: is damaged: block_shape = 0: must be 1 to 3"),
        (lambda file: file.renameVariable("block_shape", "other"), "2.nc: is damaged: block_shape"),
        (
            without_attribute,
            "merge: a part has different boulder variables from those of the first part",
        ),
    ],
)
def test_a_part_with_other_shapes_is_refused(gallery, tmp_path, change, message):
    names = [gallery.copy("parts", write_parts, tmp_path) / f"{k}.nc" for k in (1, 2)]
    with netCDF4.Dataset(names[1], "a") as file:
        file.set_auto_maskandscale(False)
        change(file)
    with pytest.raises(rockfall.RockfallError, match=f"{re.escape(message)}$"):
        rockfall.merge(names)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "name, value",
    [("shape_ground", 9), ("shape_ground", 0), ("source_shape", 4), ("source_shape", -1)],
)
def test_a_scene_file_with_other_numbers_is_refused(gallery, tmp_path, name, value):
    done = run_changed(gallery, tmp_path, lambda file: file[name].__setitem__(0, value))
    refused_in_one_line(done, f"scene.nc: is damaged: {name} is missing or malformed")


def moved_record(file):
    """Move a record from one table to the next, so that their numbers disagree with the bins."""
    shape = file["table_shape"][:]
    shape[:2, -1] += [-1, 1]
    file["table_shape"][:] = shape


TABLES_APART = "case.nml: arrays table_... are inconsistent with each other or with ground_table"
DAMAGED_TABLE = "is a damaged impact table"


@pytest.mark.family(3)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda file: file["ground_table"].__setitem__(0, 99), TABLES_APART),
        (lambda file: file["ground_table"].__setitem__(0, -1), TABLES_APART),
        (lambda file: file["table_shape"].__setitem__((0, 0), 100000), TABLES_APART),
        (lambda file: file["table_shape"].__setitem__((0, 2), 99999), TABLES_APART),
        (lambda file: file["table_shape"].__setitem__((0, 5), 0), TABLES_APART),
        (moved_record, DAMAGED_TABLE),
        (lambda file: file["table_record"].__setitem__((0, 3), np.nan), DAMAGED_TABLE),
        (lambda file: file["table_first"].__setitem__(1, 2**30), DAMAGED_TABLE),
        (lambda file: file.renameVariable("table_map", "map"), "is damaged: table_map is missing"),
    ],
)  # fmt: skip
def test_tables_of_a_scene_file_that_cannot_be_are_refused(gallery, tmp_path, change, words):
    done = run_changed(gallery, tmp_path, change)
    assert done.returncode == 2 and words in done.stderr
    assert done.stderr.count("\n") == 1 and not (tmp_path / "ready/out.nc").exists()


def test_a_scene_file_of_an_earlier_layout_names_the_command_that_makes_it_again(gallery, tmp_path):
    layout = np.int64(2)
    done = run_changed(gallery, tmp_path, lambda file: file.setncattr("scene_layout", layout))
    words = "scene.nc: is not a scene file with layout 3: create it with `rockfall prepare`"
    refused_in_one_line(done, words)


def prepare_three(folder):
    rows = NAMES + ROWS_OF_SOURCES.replace(",380", ",4999980").replace(",300", ",4999900")
    rows = re.sub(r"(?m)^(\d),(\d+),", lambda m: f"{m[1]},{600000 + int(m[2])},", rows)
    (folder / "sources.csv").write_text(rows)
    case = full_case(folder).replace(
        release={"x": None, "y": None, "points": "sources.csv"}, case={"boulders": 2}
    )
    prepare(case, folder / "ready")


def run_changed(gallery, tmp_path, change):
    """Run rockfall-batch on a scene with three shapes, after `change` of its file."""
    gallery.copy("three shapes", prepare_three, tmp_path)
    with netCDF4.Dataset(tmp_path / "ready" / "scene.nc", "a") as file:
        file.set_auto_maskandscale(False)
        change(file)
    return run_program("case.nml", "-o", "out.nc", cwd=tmp_path / "ready")


DOUBTED = [  # keys, expected doubt
    ({SHARE: [0.5, 0.5, 0.0]}, "block_shape_share: no boulder has the shape platy: fraction "
                               "0"),
    (LISTED | dict.fromkeys((*SHAPES_OF_MIX, "volume_std")) | {"block_axes": [1.2, 0.9, 0.008] * 4},
     "block_axes: the longest axis of a block is 150 times the shortest: are all axes in the "
     "same unit?"),
]  # fmt: skip


@pytest.mark.parametrize("keys, text", DOUBTED)
def test_shapes_that_are_hardly_meant_are_doubted(tmp_path, keys, text):
    case = case_in(tmp_path, impact={"table": "talus", "sets": None}, boulder=MIX | keys, **place())
    assert f"case: &boulder {text}" in implausible(read_scene(case, **terrain()))


def test_axes_of_sources_in_several_units_are_doubted(tmp_path):
    rows = f"{NAMES}1,150,380,,1.2,0.9,0.008\n2,120,380,,1.2,0.9,0.8\n"
    texts = implausible(read_scene(by_sources(tmp_path, rows), **terrain()))
    (text,) = (text for text in texts if "axis" in text)
    assert "sources.csv: line 2: the longest axis of a block is 150 times the shortest" in text


def test_shares_beside_the_shapes_are_refused_with_their_key(tmp_path):
    (tmp_path / "case.nml").write_text(
        "&case boulders = 1 /\n&terrain dem = 'd.tif' /\n&impact table = 'talus' /\n"
        "&boulder volume_mean = 1.0, block_shape = 'compact' 0.5, 'platy' 0.5 /\n"
        "&release x = 1.0, y = 1.0 /\n"
    )
    with pytest.raises(
        rockfall.RockfallError, match="in quotes, give fractions in block_shape_share$"
    ):
        rockfall.read_case(tmp_path / "case.nml")
