# SPDX-License-Identifier: BSD-3-Clause
"""One case by every rebound model: models run as they would alone, and differences are between the
same boulders."""

import csv
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import rockfall
from made import make_raster
from programs import everything, make_full_case, refuses
from rockfall.cli import main
from rockfall.grounds import GroundTable, shipped_grounds
from rockfall.result.crossings import at_lines
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall.studies.model_scenes import ROCKS, variants, with_rocks
from rockfall.studies.models import COLUMNS, read_models, run_models, write_models
from rockfall.tables.models import spread_answer

SHIPPED = GroundTable(shipped_grounds())
CLASSICAL = [*ROCKS]
#: Classical models for ground without rock sizes; rockyfor3d needs a size.
UNSIZED = [
    "pfeiffer_bowen pfeiffer_talus", "pfeiffer_bowen pfeiffer_rock", "constant constant_talus",
    "constant rock_ledge", "bourrier_hungr bourrier_hungr",
]  # fmt: skip


@pytest.fixture(scope="module")
def made(gallery):
    def make(folder):
        case = case_of_zones(folder)
        return case, run_models(case)

    return gallery.value("models", make)


@pytest.fixture(scope="module")
def case(made):
    return made[0]


@pytest.fixture(scope="module")
def found(made):
    return made[1]


def case_of_zones(folder):
    """Zones with small and with large rocks, and a zone that is a road in every model."""
    case = make_full_case(folder, case={"boulders": 50})
    ids = np.tile(np.repeat([4, -2, 5], 2), (80, 10))
    make_raster(folder / "zones.tif", ids.astype("i2"), crs="EPSG:32632")
    head = "zone,mean_radius,rg70,rg20,rg10,ground\n"
    rows = "4,0.02,0.05,0.04,0.03,\n-2,0.3,0.6,0.5,0.7,\n5,,,,,road\n"
    (folder / "zones.csv").write_text(head + rows)
    return case


def at(found, model, line, quantity, statistic="mean"):
    table = found.table.set_index(["model", "line", "quantity", "statistic"])
    return table.loc[model, line, quantity, statistic]


def test_each_model_is_run_as_it_would_be_alone(case, found):
    assert found.names == ("impact sets, method B", "impact sets, method A", *CLASSICAL)
    assert list(found.table.columns) == COLUMNS
    assert "33.3 % of the terrain has named grounds, identical in all models" in found.notes
    result = rockfall.run(case)
    mean = result["plan_distance"].values.mean()
    assert at(found, "impact sets, method B", "", "stopping_distance")["value"] == mean
    result = rockfall.run(case.replace(surface={"method": "A"}))
    mean = np.nanmean(at_lines(result)["line_speed"].values[0])
    row = at(found, "impact sets, method A", "Straße", "speed")
    assert np.isclose(row["value"], mean, rtol=1e-14) and row["low"] < mean < row["high"]


def test_the_line_is_said_at_which_models_differ_widely(found):
    """Half of the boulders pass by impact sets, one in 50 by all other models. Nothing is reported
    if the models agree."""
    rows = found.table["statistic"] == "fraction"
    table = found.table[rows & (found.table["line"] == "Straße")].copy()
    table[["value", "low", "high"]] = 0.02, 0.018, 0.022
    table.loc[table["model"] == "impact sets, method B", ["value", "low", "high"]] = 0.5, 0.4, 0.6
    assert len(table) == len(found.names)
    (text,) = spread_answer(replace(found, table=table))
    assert text.startswith("Straße: rebound models differ by a factor of 25 in frequency.")
    table["value"] = table["low"] = table["high"] = 0.02
    assert not [*spread_answer(replace(found, table=table)), *spread_answer(None)]


def test_rocks_choose_the_ground_and_named_grounds_stay(case):
    small, large = (SHIPPED.ground(name, case) for name in ROCKS["rockyfor3d"])
    scene = with_rocks(read_scene(case), small, large)
    assert [one.name for one in scene.grounds] == ["soil_3", "soil_4", "road"]
    assert scene.rasters.material_ground.tolist() == [1, 2, 3]
    result = run_scene(scene)
    assert (result["rebounds_by_ground"] > 0).all()
    one = with_rocks(read_scene(case), large, large)
    assert [rule.name for rule in one.grounds] == ["soil_4", "road"]
    assert one.rasters.material_ground.tolist() == [1, 1, 2]


@pytest.mark.parametrize("way", ["uniform", "raster", "map", "map and raster"])
def test_sizes_may_come_in_any_way(tmp_path, way):
    case = make_full_case(tmp_path)
    surface = {"zones": None, "table": None}
    radii = np.where(np.arange(60) < 30, 0.03, 0.2) + np.zeros((80, 1))
    if "raster" in way:
        make_raster(tmp_path / "rm.tif", radii.astype("f4"), crs="EPSG:32632")
        surface["mean_radius"] = "rm.tif"
    else:
        surface["uniform_mean_radius"] = 0.2
    if "map" in way:
        ids = np.where(np.arange(80) < 40, 0, 6)[:, None] + np.zeros((1, 60), int)
        make_raster(tmp_path / "soil.tif", ids.astype("i2"), nodata=0, crs="EPSG:32632")
        surface["ground_map"] = "soil.tif"
    small, large = (SHIPPED.ground(name, case) for name in ROCKS["pfeiffer_bowen"])
    scene = with_rocks(read_scene(case.replace(surface=surface)), small, large)
    names = [one.name for one in scene.grounds]
    if way == "uniform":
        assert names == ["pfeiffer_rock"] and scene.rasters.cell_ground is None
    else:
        here = np.array(names)[scene.rasters.cell_ground - 1]
        wanted = np.where(np.arange(60) < 30, "pfeiffer_talus", "pfeiffer_rock")
        wanted = wanted if "raster" in way else np.full(60, "pfeiffer_rock")
        assert (here[10] == wanted).all()
        assert (here[60] == ("soil_6" if "map" in way else wanted)).all()
    run_scene(scene)


def test_differences_are_those_of_the_same_boulders(case, found):
    """Differences are from the first model, where they are zero. Their intervals are from
    differences boulder by boulder, narrower than for two samples; that of a fraction depends on how
    many boulders pass in only one of the two models."""
    first = found.table[found.table["model"] == found.names[0]]
    means = first[first["statistic"] != "q95"].dropna(subset="difference")
    assert (means[["difference", "difference_low", "difference_high"]] == 0).all(axis=None)
    a, b = (at(found, name, "", "stopping_distance") for name in found.names[:2])
    assert np.isclose(b["difference"], b["value"] - a["value"], rtol=1e-12)
    paired, apart = (
        (b["difference_high"] - b["difference_low"]) / 2,
        np.hypot((a["high"] - a["low"]) / 2, (b["high"] - b["low"]) / 2),
    )
    assert paired < apart
    row = at(found, found.names[1], "Straße", "boulders", "fraction")
    other = at(found, found.names[0], "Straße", "boulders", "fraction")
    assert np.isclose(row["difference"], row["value"] - other["value"])
    speed = at(found, found.names[1], "Straße", "speed")
    alone = at(found, found.names[0], "Straße", "speed")
    assert np.isclose(speed["difference"], speed["value"] - alone["value"])
    assert speed["difference_low"] < speed["difference"] < speed["difference_high"]


def test_intervals_of_differences_that_no_normal_distribution_has(case):
    """A single boulder has no interval. If boulders pass only in the first model, the interval is
    that of their fraction (Wilson 1927): on a lake all boulders stop."""
    case = case.replace(release={"x": [600152.0], "y": [4999980.0]})
    one = run_models(case.replace(case={"boulders": 1}), ["soil_0"])
    row = at(one, "soil_0", "", "stopping_distance")
    assert row["difference"] < 0 and np.isnan(row["difference_low"])
    found = run_models(case.replace(case={"boulders": 20}), ["soil_0", "soil_0"])
    first, lake = (at(found, name, "Straße", "boulders", "fraction") for name in found.names[::2])
    p, n, z = first["value"], 20, 1.959964
    assert p > 0 and lake["value"] == 0
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    limits = lake[["difference_low", "difference", "difference_high"]]
    assert np.allclose(limits, [-middle - half, -p, half - middle], rtol=1e-6)
    outside = at(found, "soil_0", "apart", "boulders", "fraction")
    assert outside["difference"] == 0 and outside["difference_high"] == outside["high"] > 0


def test_grounds_that_cover_everything_are_varied(case):
    """All grounds are varied except those that absorb. Impact sets are left out, because they need
    rock sizes, which no ground has here."""
    by_name = case.path(case.surface["table"]).with_name("named.csv")
    by_name.write_text("zone,rg70,rg20,rg10,ground\n4,,,,road\n-2,,,,meadow\n5,,,,soil_0\n")
    case = case.replace(surface={"table": by_name.name}, case={"boulders": 5})
    found = run_models(case)
    assert found.names == ("grounds of the case", *UNSIZED)
    assert found.notes[0].startswith("no zone gives a rock radius")
    scene = read_scene(case)
    small, large = (SHIPPED.ground(name, case) for name in ROCKS["constant"])
    varied = with_rocks(scene, small, large, {"road", "meadow"})
    names = [varied.grounds[k - 1].name for k in varied.rasters.material_ground]
    assert names == ["constant_talus", "constant_talus", "soil_0"]


def test_models_are_read_as_they_were_written(found, tmp_path):
    write_models(found, tmp_path / "models.nc")
    again = read_models(tmp_path / "models.nc")
    assert again.names == found.names and again.notes == found.notes
    assert (again.title, again.boulders) == (found.title, found.boulders)
    pd.testing.assert_frame_equal(again.table, found.table, check_dtype=False)
    assert again.case.attrs["case"] == found.case.attrs["case"]


def test_grounds_on_request(case):
    found = run_models(case.replace(case={"boulders": 5}), ["soil_6", "rocky-slope"])
    assert found.names[2:] == ("soil_6", "rocky-slope")


def test_tables_on_request_come_last_and_are_those_of_a_case_by_the_table(case):
    case = case.replace(case={"boulders": 5})
    found = run_models(case, tables=["talus", "meadow"])
    assert found.names[-2:] == ("table talus", "table meadow")
    own = run_models(case.replace(impact={"form": "table", "table": "talus", "ratio": None}))
    values = found.table.set_index("model").loc["table talus", "value"].to_numpy()
    expected = own.table.set_index("model").loc[own.names[0], "value"].to_numpy()
    assert own.names[0] == "table talus" and np.array_equal(values, expected, equal_nan=True)


def test_a_case_with_a_ground_comes_first_as_it_is(case):
    case = case.replace(surface={"ground": "meadow"}, case={"boulders": 5})
    found = run_models(case)
    assert found.names == ("meadow", "impact sets, method B", "impact sets, method A", *CLASSICAL)


def test_a_case_by_a_table_is_run_by_it_and_by_impact_sets(case):
    case = case.replace(case={"boulders": 5})
    by_table = {"impact": {"table": "meadow"}, "boulder": {"block_shape": "platy"}}
    found = run_models(case.replace(**by_table))
    sets = ("impact sets, method B", "impact sets, method A")
    assert found.names == ("table meadow", *sets, *CLASSICAL)
    own = run_models(case)
    for name in sets:
        assert values(found, name) == values(own, name) != values(found, "table meadow")


def test_zones_keep_a_table_that_they_name_though_it_is_that_of_the_case(case):
    """Zones keep a table that they name, like any other ground. If all zones name it, all are
    varied."""
    path = case.path(case.surface["table"])
    sized = path.read_text()
    case = case.replace(
        surface={"table": "talus.csv"}, impact={"table": "talus"}, case={"boulders": 5}
    )
    named = sized.replace("0.02,0.05,0.04,0.03,", "0.02,0.05,0.04,0.03,talus")
    path.with_name("talus.csv").write_text(named)
    notes = []
    scenes = dict(variants(case, ["meadow"], notes))
    assert scenes["table talus"].rasters.material_ground.tolist() == [1, 1, 2]
    for name, rest in ("impact sets, method B", "sets.nml"), ("meadow", "meadow"):
        grounds, numbers = scenes[name].grounds, scenes[name].rasters.material_ground
        tables = [grounds[number - 1].text for number in numbers]
        assert tables[0] == scenes["table talus"].grounds[0].text != tables[1]
        assert [grounds[number - 1].name for number in numbers[1:]] == [rest, "road"]
    found = run_models(case)
    assert "66.7 % of the terrain has named grounds, identical in all models" in found.notes
    path.with_name("talus.csv").write_text(named.replace("0.7,", "0.7,talus"))
    assert run_models(case).names == ("grounds of the case", "impact sets, method B", *CLASSICAL)


def test_without_sizes_of_rocks_classical_models_run_by_either_ground(case):
    """Without rock sizes, classical models run with both of their grounds: a missing size must not
    count as a small size."""
    bare = {"zones": None, "table": None}
    case = case.replace(impact={"table": "talus"}, surface=bare, case={"boulders": 20})
    found = run_models(case)
    assert found.names == ("table talus", *UNSIZED)
    assert found.notes[0] == (
        "rock sizes are missing: rockyfor3d omitted, other classical models run with both of their "
        "grounds, for rocks below and above 0.1 m"
    )
    for ground in ROCKS["pfeiffer_bowen"]:
        alone = rockfall.run(case.replace(surface={"ground": ground}))
        mean = alone["plan_distance"].values.mean()
        assert at(found, f"pfeiffer_bowen {ground}", "", "stopping_distance")["value"] == mean


@pytest.mark.parametrize("ground", ["soil_3", "rocky-slope"])
def test_a_ground_that_needs_sizes_of_rocks_is_refused_without(case, ground):
    bare = {"zones": None, "table": None}
    case = case.replace(impact={"table": "talus"}, surface=bare, case={"boulders": 5})
    with pytest.raises(rockfall.RockfallError) as caught:
        run_models(case, ["meadow", ground])
    assert str(caught.value) == (f"{case.name}: --ground {ground}: requires rock sizes in &surface")


def test_rocks_without_a_size_beside_others_are_said(case):
    radii = np.where(np.arange(60) < 30, np.nan, 0.2) + np.zeros((80, 1))
    make_raster(case.path("part.tif"), radii.astype("f4"), crs="EPSG:32632")
    surface = {"zones": None, "table": None, "mean_radius": "part.tif"}
    case = case.replace(impact={"table": "talus"}, surface=surface)
    found = run_models(case.replace(case={"boulders": 5}))
    assert set(CLASSICAL) < set(found.names)
    assert found.notes[0] == (
        "50.0 % of the varied ground has no rock size: classical models assume rocks below 0.1 m "
        "there"
    )
    found = run_models(case.replace(case={"boulders": 5}), ["meadow", "soil_3"])
    assert found.notes[0] == (
        "50.0 % of the varied ground has no rock size: soil_3 have no obstacles there"
    )


def values(models, name):
    return models.table[models.table.model == name].value.dropna().tolist()


def test_the_command_writes_a_table_and_a_figure(case, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ["models", case.name, "-o", "out", "--boulders", "20"]
    (tmp_path / "out").mkdir()
    (tmp_path / "out/models.csv").write_text("of before")
    refuses(command, "out.models.csv: already exists; not overwritten .*", capsys)
    assert main([*command, "--overwrite"]) == 0
    out = capsys.readouterr().out
    assert "impact sets, method A" in out and "run-out in plan" in out and " +" in out
    with open("out/models.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [*rows[0]] == COLUMNS and {row["model"] for row in rows} >= {*CLASSICAL}
    assert (tmp_path / "out/models.png").read_bytes().startswith(b"\x89PNG")
    made = [path.name for path in everything(tmp_path) if path.is_file()]
    assert {*made} == {"models.csv", "models.nc", "models.png"}
    words = ["models", case.name, "-o", "new", "--ground", "mud"]
    refuses(
        words,
        "--ground = 'mud': is not a ground of grounds.csv, an impact table or an impact set.*",
        capsys,
    )
