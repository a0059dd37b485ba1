# SPDX-License-Identifier: BSD-3-Clause
"""Grounds of zones, of a raster, and of a complete case; bad tables and names are refused in one
line."""

import csv

import numpy as np
import pytest
from affine import Affine

import rockfall
from made import make_raster, refused
from rockfall.analysis.validity.rebounds import has_own_grounds
from rockfall.errors import RockfallError
from rockfall.grounds.grounds import (
    IMPACT_SETS,
    TABLES,
    WORDS,
    YIELDING,
    GroundTable,
    find_ground,
    models,
    other_tables,
    parameters,
    shipped_grounds,
    table_names,
)
from rockfall.scene.read import read_scene
from scenes import CALM_SETS, grid, make_case, rough, sets

HEAD = "name,model,r_n,r_t,half_speed,friction_angle,roughness_angle,source\n"
SHIPPED = GroundTable(shipped_grounds())


@pytest.fixture(autouse=True)
def in_tmp_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sets.nml").write_text(CALM_SETS)


def case_with(tmp_path, **surface):
    release = {"x": [150.0], "y": [380.0], "drop_height": 5.0}
    return make_case(tmp_path, *sets(), release=release, surface=surface)


def read(case, **arrays):
    z = rough()
    return read_scene(case, dem=z, transform=grid(z), **arrays)


def zones(tmp_path, rows, head="zone,mean_radius,ground\n"):
    (tmp_path / "zones.csv").write_text(head + rows)
    ids = np.repeat([[1, 2, 3]], 20, axis=1).repeat(80, axis=0)
    return {"zones": ids.astype("i4")}, {"zones": "given", "table": "zones.csv"}


# ---- the shipped table


@pytest.mark.family(3)
@pytest.mark.parametrize("name", SHIPPED.rows)
def test_every_shipped_ground_runs_and_names_its_source(tmp_path, name):
    row = SHIPPED.rows[name]
    assert row.cells["source"] and row.cells["meaning"]
    case = case_with(tmp_path, uniform_mean_radius=0.1, ground=name)
    z = rough()
    result = rockfall.run(case, dem=z, transform=grid(z))
    assert result["ground"].values.tolist() == [name]
    model = row.cells["model"]
    assert result["ground_model"].values == ["impact_table" if model in YIELDING else model]
    absorbed = model == "absorbs"
    assert (int(result["rebounds_by_ground"].sum()) == 0) == absorbed
    assert int(result["rebounds_by_ground"].sum()) == int(result["rebounds"])
    assert not any(int(result[f"rebounds_out_of_{of}"]) for of in ("range", "angle"))
    assert int(result["rebounds_out_of_speed"]) <= 0.03 * int(result["rebounds"])


def test_soil_types_have_their_numbers_as_ids():
    assert SHIPPED.names == {k: f"soil_{k}" for k in range(8)}
    mean = [float(SHIPPED.rows[f"soil_{k}"].cells["r_n"]) for k in range(1, 8)]
    assert mean == [0.23, 0.28, 0.33, 0.38, 0.43, 0.53, 0.35]


def test_the_kernels_table_is_that_of_the_file():
    """Numeric columns of the shipped file are the parameters of the kernel, each used by at least
    one model."""
    with open(shipped_grounds(), newline="") as file:
        columns = next(csv.reader(file))
    names = [one.name for one in parameters()]
    assert sorted(set(columns) - {*WORDS}) == sorted(names)
    of_models = {model for one in parameters() for model in one.models.split(", ")}
    assert of_models | {IMPACT_SETS, *TABLES, "absorbs"} == {*models()}


def test_ranges_of_2023_are_a_table_of_their_own(tmp_path):
    """The table with the ranges of 2023 is chosen by name, has the same grounds, and does not count
    as a user's table."""
    (path,) = other_tables().values()
    table = GroundTable(path)
    assert table.names == SHIPPED.names
    keys = "r_n_min", "r_n", "r_n_max"
    numbers = {
        name: [float(row.cells[key]) for key in keys]
        for name, row in table.rows.items()
        if row.cells["model"] != "absorbs"
    }
    usual = {name: [float(SHIPPED.rows[name].cells[key]) for key in keys] for name in numbers}
    differ = {name for name, row in numbers.items() if row != usual[name]}
    assert differ == {"soil_2", "soil_3", "soil_4", "soil_5"}
    assert numbers["soil_2"][::2] == [0.30, 0.36] and numbers["soil_5"][::2] == [0.21, 0.25]
    case = case_with(
        tmp_path, uniform_mean_radius=0.05, ground="soil_4", ground_table="rockyfor3d-2023"
    )
    assert not has_own_grounds(case)
    assert has_own_grounds(case.replace(surface={"ground_table": "mine.csv"}))
    (ground,) = read(case).grounds
    assert b"r_n = 0.43 " in ground.text
    mean = rockfall.run(case, dem=rough(), transform=grid(rough()))["plan_distance"].mean()
    usual_case = case.replace(surface={"ground_table": None})
    usual_mean = rockfall.run(usual_case, dem=rough(), transform=grid(rough()))["plan_distance"]
    assert mean > usual_mean.mean()


# ---- where grounds are named


def test_a_zone_names_its_ground_or_has_the_cases(tmp_path):
    (tmp_path / "own.nml").write_text(CALM_SETS)
    arrays, surface = zones(tmp_path, "1,0.2,\n2,,road\n3,0.3,own.nml\n")
    scene = read(case_with(tmp_path, **surface), **arrays)
    assert [one.name for one in scene.grounds] == ["sets.nml", "road", "own.nml"]
    assert [one.model for one in scene.grounds] == [IMPACT_SETS, "constant", IMPACT_SETS]
    assert scene.rasters.material_ground.tolist() == [1, 2, 3]
    assert scene.rasters.sizes[:, 0].tolist() == [0.2, 0.0, 0.3]


def test_zones_that_all_name_theirs_leave_no_place_for_the_cases(tmp_path):
    arrays, surface = zones(tmp_path, "1,,road\n2,,meadow\n3,,road\n")
    scene = read(case_with(tmp_path, **surface), **arrays)
    assert [one.name for one in scene.grounds] == ["road", "meadow"]
    assert scene.rasters.material_ground.tolist() == [1, 2, 1]


def test_rocks_of_no_size_are_for_grounds_that_need_none(tmp_path):
    z = rough()
    case = case_with(tmp_path, uniform_mean_radius=0.0, ground="road")
    assert read(case).rasters.sizes.tolist() == [[0.0]]
    for ground, name in (("laboratory-spheres", "laboratory-spheres"), (None, "sets.nml")):
        with pytest.raises(
            rockfall.RockfallError, match=f"ground '{name}' requires mean_radius > 0"
        ):
            rockfall.run(case.replace(surface={"ground": ground}), dem=z, transform=grid(z))


def test_zones_without_a_name_have_the_ground_of_the_surface(tmp_path):
    arrays, surface = zones(tmp_path, "1,,\n2,,road\n3,,\n", "zone,rg70,ground\n".replace(
        "rg70", "note"))  # fmt: skip
    scene = read(case_with(tmp_path, ground="meadow", **surface), **arrays)
    assert [one.name for one in scene.grounds] == ["meadow", "road"]
    assert scene.rasters.material_ground.tolist() == [1, 2, 1]


def test_a_raster_of_ids_goes_with_any_way_to_give_sizes(tmp_path):
    ids = np.repeat([[0, 3, 6, -1]], 15, axis=1).repeat(80, axis=0)
    ground_map = np.ma.masked_equal(ids, -1)
    radii = np.full((80, 60), 0.2, "f4")
    radii[:, :15] = np.nan  # water has no rocks
    ways = [
        ({"uniform_mean_radius": 0.2}, {}),
        ({"mean_radius": "given"}, {"mean_radius": radii}),
        ({"uniform_rg": [0.2, 0.3, 0.4], "method": "A"}, {}),
    ]
    numbers = []
    for surface, arrays in ways:
        case = case_with(tmp_path, ground_map="given", **surface)
        scene = read(case, ground_map=ground_map, **arrays)
        numbers.append(scene.rasters.cell_ground)
        names = [one.name for one in scene.grounds]
        assert names == ["sets.nml", *(f"soil_{k}" for k in range(8))]
    assert all(np.array_equal(one, numbers[0]) for one in numbers)
    assert numbers[0][5, ::15].tolist() == [2, 5, 8, 1]
    stored = np.where(ids < 0, -99, ids).astype("i2")
    make_raster(tmp_path / "soil.tif", stored, Affine(5, 0, 0, 0, -5, 400), None, nodata=-99)
    scene = read(case_with(tmp_path, uniform_mean_radius=0.2, ground_map="soil.tif"))
    assert np.array_equal(scene.rasters.cell_ground, numbers[0])


def test_ground_that_needs_no_rocks_needs_no_sizes(tmp_path):
    scene = read(case_with(tmp_path, ground="pfeiffer_rock"))
    assert scene.rasters.sizes.tolist() == [[0.0]] and [one.name for one in scene.grounds] == [
        "pfeiffer_rock"
    ]


def test_a_ground_of_impact_sets_is_the_case_with_these_sets(tmp_path):
    """Results are bit-identical, and so are counts of rebounds beyond the fit ranges."""
    z = rough()
    case = case_with(tmp_path, uniform_mean_radius=0.2, ground="laboratory-spheres")
    one = rockfall.run(case, dem=z, transform=grid(z))
    case = case.replace(surface={"ground": None}, impact={"sets": "laboratory-spheres"})
    other = rockfall.run(case, dem=z, transform=grid(z))
    for name in set(other.variables) - {"boulder"}:
        assert np.array_equal(one[name], other[name], equal_nan=one[name].dtype.kind == "f"), name
    assert int(one["rebounds_out_of_speed"]) > 0


# ---- what is refused

BAD_ROWS = {
    "a,Constant,0.4,0.9,,,,x": "model = Constant: must be one of rockyfor3d, pfeiffer_bowen, "
    "bourrier_hungr, constant, absorbs, ploughed, hard",
    "a,constant,0.4,,,,,x": "&ground r_t is missing: needed for model = 'constant'",
    "a,constant,,0.9,,,,x": "&ground r_n is missing: needed for model = 'constant'",
    "a,constant,1.4,0.9,,,,x": "&ground r_n = 1.4: must be 0 to 1",
    "a,constant,-0.1,0.9,,,,x": "&ground r_n = -0.1: must be 0 to 1",
    "a,constant,nan,0.9,,,,x": "r_n = nan: must be a number",
    "a,constant,inf,0.9,,,,x": "r_n = inf: must be a number",
    "a,constant,0.4 /,0.9,,,,x": "r_n = 0.4 /: must be a number",
    "a,constant,0.4,0.9,3,,,x": "&ground half_speed = 3: is not valid for model = 'constant'",
    "a,constant,0.4,0.9,,,60,x": "&ground roughness_angle = 60: must be 0 to 45 [degree]",
    "a,pfeiffer_bowen,0,0.9,,,,x": "&ground r_n = 0: must be at least 0.01 for this model",
    "a,bourrier_hungr,,0.9,0,30,,x": "&ground half_speed = 0: must be 0.01 to 1000 [m/s]",
    "a,bourrier_hungr,,0.9,5,,,x": "&ground friction_angle is missing: needed for model = "
    "'bourrier_hungr'",
    "a,absorbs,0.4,,,,,x": "&ground r_n = 0.4: is not valid for model = 'absorbs'",
    "a,constant,0.4,0.9,,,,": "source = : must not be empty",
    ",constant,0.4,0.9,,,,x": "name = : must not be empty",
    "a,constant,0.4,0.9,,,,x\na,constant,0.4,0.9,,,,x": "name = a: must be unique among grounds",
}

COLUMNS = ", ".join(("name", "id", "model", "meaning", "source", *(p.name for p in parameters())))
IDS = "name,id,model,source\n"
BAD_TABLES = {
    **{f"{HEAD}{rows}\n": f"line {2 + rows.count(chr(10))}: {said}"
       for rows, said in BAD_ROWS.items()},
    "": "is empty",
    HEAD: "no rows below the header",
    "name,model\na,absorbs\n": "line 1: column source is missing (columns: name, model)",
    "name,model,source,colour\n": f"line 1: column colour: must be one of {COLUMNS}",
    "name,model,source,r_n,r_n\n": "line 1: column r_n occurs twice",
    "name,model,r_n,r_n_min,r_n_max,r_t,source\na,constant,0.4,0.5,0.6,0.9,x\n":
        "line 2: &ground r_n = 0.4: must lie between r_n_min and r_n_max",
    f"{IDS}a,-1,absorbs,x\n": "line 2: id = -1: must be an integer from 0 to 999999999",
    f"{IDS}a,1.5,absorbs,x\n": "line 2: id = 1.5: must be an integer from 0 to 999999999",
    f"{IDS}b,1,absorbs,x\na,1,absorbs,x\n": "line 3: id = 1: must be unique among grounds",
}  # fmt: skip


@pytest.mark.parametrize("table", BAD_TABLES)
def test_bad_tables(tmp_path, table):
    (tmp_path / "grounds.csv").write_text(table)
    case = case_with(tmp_path, uniform_mean_radius=0.2, ground="a", ground_table="grounds.csv")
    with refused(f"{tmp_path}/grounds.csv: {BAD_TABLES[table]}"):
        read(case)


def test_names_that_nothing_has(tmp_path):
    known = f"Grounds: {', '.join(SHIPPED.rows)}. Impact tables: {', '.join(table_names())}. "
    said = (
        "'mud': is not a ground of grounds.csv, an impact table or an impact set. "
        f"{known}Impact sets: bourrier2009-ensemble"
    )
    with pytest.raises(RockfallError) as caught:
        read(case_with(tmp_path, ground="mud"))
    assert str(caught.value).startswith(f"case: &surface ground = {said}")
    arrays, surface = zones(tmp_path, "1,0.2,\n2,,mud\n3,0.3,\n")
    with pytest.raises(RockfallError) as caught:
        read(case_with(tmp_path, **surface), **arrays)
    assert str(caught.value).startswith(f"{tmp_path / 'zones.csv'}: line 3: ground = {said}")


def test_sizes_that_a_ground_needs(tmp_path):
    arrays, surface = zones(tmp_path, "1,0.2,\n2,,soil_4\n3,0.3,\n")
    with refused(f"{tmp_path}/zones.csv: zone 2: ground 'soil_4' requires mean_radius"):
        read(case_with(tmp_path, **surface), **arrays)
    arrays, surface = zones(tmp_path, "1,0.2,\n2,0,rocky-slope\n3,0.3,\n")
    with refused(f"{tmp_path}/zones.csv: zone 2: ground 'rocky-slope' requires mean_radius > 0"):
        read(case_with(tmp_path, **surface), **arrays)
    with refused("case: &surface: ground 'soil_4' requires mean_radius"):
        read(case_with(tmp_path, ground="soil_4"))
    with refused("case: &surface: ground 'sets.nml' requires mean_radius > 0"):
        ids = np.full((80, 60), 3, np.int32)
        ids[:4] = -1
        read(case_with(tmp_path, ground_map="given"), ground_map=np.ma.masked_equal(ids, -1))
    radii = np.full((80, 60), 0.2, "f4")
    radii[:, 7] = np.nan
    radii[:, 9] = 0.0
    said = "80 cells of the terrain without a value, 0 not > 0 (Inf absorbs)"
    with refused(f"{tmp_path}/(array): {said}"):
        read(case_with(tmp_path, mean_radius="given", ground="soil_4"), mean_radius=radii)
    read(case_with(tmp_path, mean_radius="given", ground="road"), mean_radius=radii)


def test_a_size_that_no_ground_needs_may_be_empty(tmp_path):
    """A zone with an impact table may have no size; impact sets and zones without a ground require
    one."""
    arrays, surface = zones(tmp_path, "1,0.2,\n2,,\n3,,rock\n")
    case = case_with(tmp_path, **surface)
    scene = read(case.replace(impact={"form": "table", "table": "meadow"}), **arrays)
    assert scene.rasters.sizes.ravel().tolist() == [0.2, 0.0, 0.0]
    with refused(f"{tmp_path}/zones.csv: zone 2: ground 'sets.nml' requires mean_radius > 0"):
        read(case, **arrays)
    arrays, surface = zones(tmp_path, "1,0.2\n2,\n3,0.3\n", "zone,mean_radius\n")
    with refused(f"{tmp_path}/zones.csv: zone 2: method B requires mean_radius"):
        read(case_with(tmp_path, **surface), **arrays)
    arrays["zones"][arrays["zones"] == 2] = 1
    read(case_with(tmp_path, **surface), **arrays)


def test_a_map_and_zones_with_grounds(tmp_path):
    arrays, surface = zones(tmp_path, "1,0.2,\n2,,road\n3,0.3,\n")
    with refused("case: &surface ground_map: the zones have their own grounds "
                 f"({tmp_path}/zones.csv: line 3): give only one"):  # fmt: skip
        arrays["ground_map"] = arrays["zones"]
        read(case_with(tmp_path, ground_map="given", **surface), **arrays)


def test_ids_that_no_ground_has(tmp_path):
    ids = np.full((80, 60), 3, np.int32)
    ids[0, :5] = 9
    with refused(f"{tmp_path}/(array): id 9 (5 cells) has no row in {shipped_grounds()}"):
        read(case_with(tmp_path, uniform_mean_radius=0.2, ground_map="given"), ground_map=ids)


def test_files_that_are_not_there(tmp_path):
    with refused("case: &surface ground_table = 'none.csv': no such file"):
        read(case_with(tmp_path, ground="road", ground_table="none.csv"))
    with refused("case: &surface ground_map = 'none.asc': no such file"):
        read(case_with(tmp_path, uniform_mean_radius=0.2, ground_map="none.asc"))


def test_sets_that_are_no_sets(tmp_path):
    (tmp_path / "bad.nml").write_text("&impact_set ratio = 1 /\n")
    with refused(f"{tmp_path}/bad.nml: &impact_set mean: is missing"):
        read(case_with(tmp_path, uniform_mean_radius=0.2, ground="bad.nml"))


def test_a_name_of_a_ground_comes_before_a_file(tmp_path):
    (tmp_path / "road").write_text(CALM_SETS)
    case = case_with(tmp_path, uniform_mean_radius=0.2)
    assert find_ground(case, SHIPPED, "road", "").model == "constant"


def test_a_zone_without_a_ground_is_reported_unless_the_case_chooses_one(tmp_path):
    """A remark gives the zones without a ground, but only if the case does not choose impact sets
    or a ground itself."""
    rows = "1,0.2,talus\n2,0.2,\n3,inf,\n"
    arrays, surface = zones(tmp_path, rows)
    case = case_with(tmp_path, **surface)
    unset = case.replace(impact={"sets": None})
    remarks = read(unset, **arrays).remarks
    said = "no ground (1 of 3 zones), so the default vaujany-observed applies"
    assert [said in line for line in remarks].count(True) == 1
    assert f"{tmp_path / 'zones.csv'}: line 3: {said}" in "\n".join(remarks)
    for own in (case, unset.replace(surface={"ground": "meadow"})):
        assert not [line for line in read(own, **arrays).remarks if "no ground" in line]
    arrays, surface = zones(tmp_path, rows.replace("2,0.2,", "2,,"))
    unset = unset.replace(surface=surface)
    said = "ground is missing: give one (the default 'vaujany-observed' requires mean_radius > 0)"
    with refused(f"{tmp_path}/zones.csv: zone 2: {said}"):
        read(unset, **arrays)
