# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a run are merged into the result of the run; other files are refused with their
names."""

import shutil
import warnings

import numpy as np
import pytest
import rasterio
from affine import Affine

import rockfall
from made import every_third, make_raster, refused
from rockfall.cli import main
from rockfall.scene.read import read_scene
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_scene
from same import same
from scenes import BOULDERS, case_in, grid, place, rough


def run(case, **how):
    z = rough()
    z[60:64, 25:28] = np.nan
    return rockfall.run(case, dem=z, transform=grid(z), **how)


@pytest.fixture
def case(tmp_path):
    return case_in(tmp_path, **place())


def files(folder, case, of):
    paths = [folder / f"{k}.nc" for k in range(1, of + 1)]
    for k, path in enumerate(paths, start=1):
        rockfall.write_result(run(case, shard=(k, of), threads=2), path)
    return paths


@pytest.mark.parametrize("of", every_third([7, 2]))
def test_parts_joined_in_any_order_are_the_run(tmp_path, case, of):
    paths, whole = files(tmp_path, case, of), run(case)
    assert not any(name.startswith("tally_") for name in whole.variables)
    same(rockfall.merge(paths[::-1]), whole)


def test_the_run_is_dated_by_its_last_part(case):
    """The date is the latest of the parts, in any order and time zone; parts of older versions have
    none."""
    dates = ["2026-11-23T23:30:00+01:00", "2026-11-23T23:00:00+00:00", ""]
    parts = [
        run(case, shard=(k, 3)).assign_attrs(date_created=date)
        for k, date in enumerate(dates, start=1)
    ]
    for order in parts, parts[::-1]:
        assert rockfall.merge(order).attrs["date_created"] == dates[1]
    with pytest.raises(rockfall.RockfallError, match="is damaged: date_created"):
        rockfall.merge([parts[0].assign_attrs(date_created="yesterday")])


def test_several_sources_and_a_part_in_the_middle_of_one(tmp_path):
    release = {"x": [130.0, 150.0, 170.0], "y": [380.0, 381.0, 379.0], "drop_height": 5.0}
    case = case_in(tmp_path, release=release)
    whole, parts = run(case), [run(case, shard=(k, 5)) for k in range(1, 6)]
    bounds = [(part.attrs["boulder_first"], part.attrs["boulder_last"]) for part in parts]
    assert bounds[0][0] == 1 and bounds[-1][1] == 3 * BOULDERS
    assert all(b[0] == a[1] + 1 for a, b in zip(bounds, bounds[1:], strict=False))
    same(rockfall.merge(parts), whole)


def test_a_part_holds_its_boulders_and_tallies_and_no_maps(case):
    part, whole = run(case, shard=(2, 3)), run(case)
    assert (part.attrs["boulder_first"], part.attrs["boulder_last"]) == (
        BOULDERS // 3 + 1, 2 * BOULDERS // 3
    )  # fmt: skip
    assert part.attrs["complete"] == 0 and part.attrs["boulders_requested"] == BOULDERS
    mine = slice(BOULDERS // 3, 2 * BOULDERS // 3)
    assert np.array_equal(part["stop_x"], whole["stop_x"].isel(boulder=mine))
    number = whole["crossing_boulder"].values
    own = (number > mine.start) & (number <= mine.stop)
    for name in ("crossing_boulder", "crossing_line", "crossing_time"):
        assert np.array_equal(np.sort(part[name]), np.sort(whole[name].values[own])), name
    assert own.sum() > 50
    assert not {"y", "x"} & set(part.dims)
    box = part.attrs["map_window"]
    counts, cells = part["tally_counts"].values[0], part["tally_cell"].values
    assert (counts <= whole["passages"].values.ravel()[cells]).all() and counts.sum() > 0
    assert cells.max() < box[2] * box[3]


def test_without_maps_lines_or_trajectories(tmp_path):
    case = case_in(tmp_path, output={}, **place()).replace(line=[])
    parts = [run(case, shard=(k, 4)) for k in range(1, 5)]
    same(rockfall.merge(parts), run(case))


@pytest.mark.all
def test_what_is_missing_twice_or_of_another_run_is_named(tmp_path, case):
    paths = files(tmp_path, case, 4)
    with refused("merge: boulders 101 to 201 are missing"):
        rockfall.merge([paths[0], *paths[2:]])
    with refused("merge: boulders 1 to 100 are missing; boulders 303 to 403 are missing"):
        rockfall.merge(paths[1:3])
    with refused(f"merge: boulders 101 to 201 occur twice: {paths[1]}"):
        rockfall.merge([*paths, paths[1]])
    other = tmp_path / "other.nc"
    rockfall.write_result(run(case, shard=(100, BOULDERS)), other)  # only boulder 100
    with refused(f"merge: boulders 100 to 100 occur twice: {other}"):
        rockfall.merge([*paths, other])
    rockfall.write_result(run(case.replace(case={"seed": 5}), shard=(2, 4)), other)
    with refused(f"{other}: belongs to a different run than {paths[0]}: its &case seed differs"):
        rockfall.merge([paths[0], other, *paths[2:]])
    z = rough(seed=2)
    rockfall.write_result(rockfall.run(case, dem=z, transform=grid(z), shard=(2, 4)), other)
    with refused(f"{other}: belongs to a different run than {paths[0]}: its dem differs"):
        rockfall.merge([paths[0], other, *paths[2:]])
    rockfall.write_result(run(case), other)
    with refused(f"{other}: is not a part of a run (from --shard, a checkpoint or rockfall-batch)"):
        rockfall.merge([other])
    with refused("merge requires the parts of a run"):
        rockfall.merge([])


@pytest.mark.parametrize("shard", [(0, 4), (5, 4), (1, BOULDERS + 1)])
def test_shards_that_cannot_be(case, shard):
    with pytest.raises(rockfall.RockfallError, match="^shard = "):
        run(case, shard=shard)


@pytest.mark.all
def test_the_commands(few_boulders, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for k in (1, 2, 3):
        assert main(["run", "case.nml", "--quiet", "--shard", f"{k}/3"]) == 0
    parts = [f"case.part{k}of3" for k in (1, 2, 3)]
    assert not list(tmp_path.glob("*.nc"))
    assert main(["merge", *parts, "-o", "all.nc"]) == 0
    assert main(["run", "case.nml", "--quiet"]) == 0
    same(rockfall.read_result("all.nc"), rockfall.read_result("case.nc"))
    capsys.readouterr()
    assert main(["merge", *parts[:2], "-o", "no.nc"]) == 2
    assert capsys.readouterr().err == "rockfall: merge: boulders 34 to 50 are missing\n"
    assert not (tmp_path / "no.nc").exists()


@pytest.mark.parametrize("text", ["4/3", "a/b", "1/3/5", ""])
def test_a_wrong_shard_is_refused_in_one_line(few_boulders, tmp_path, monkeypatch, capsys, text):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "case.nml", f"--shard={text}"]) == 2
    assert capsys.readouterr().err == (
        f"rockfall: --shard {text}: must be I/N with I from 1 to N\n"
    )
    assert not list(tmp_path.glob("*.nc"))


# ---- contents read from files count, not only the named files


def change_table(folder):
    """Change the zone in the .dbf of a shapefile from 1 to 2."""
    path = folder / "zones.dbf"
    content = path.read_bytes()
    assert content.endswith(b"1\x1a")
    path.write_bytes(content[:-2] + b"2\x1a")


def change_statistics(folder):
    """Write an offset for elevations to a file next to the raster, as GDAL does."""
    (folder / "tile.tif.aux.xml").write_text(
        '<PAMDataset><PAMRasterBand band="1"><Offset>1</Offset></PAMRasterBand></PAMDataset>'
    )


def change_mask(folder):
    (folder / "other").mkdir()
    shutil.copy(folder / "tile.tif", folder / "other")
    mask = np.full((80, 60), 255, "u1")
    mask[70:75, 20:25] = 0
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False):
        with rasterio.open(folder / "other/tile.tif", "r+") as file:
            file.write_mask(mask)
    shutil.move(folder / "other/tile.tif.msk", folder)


def make_shapefile(folder):
    """Write a shapefile with zone 1 everywhere and a table of zones 1 and 2; return keys of
    &surface."""
    pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    shapely = pytest.importorskip("shapely")
    wkb = np.array([shapely.to_wkb(shapely.box(0, 0, 300, 400))], object)
    how = {"geometry_type": "Polygon", "driver": "ESRI Shapefile", "crs": None}
    with warnings.catch_warnings(action="ignore"):  # no CRS, like the terrain
        pyogrio.raw.write(folder / "zones.shp", wkb, [np.array([1], "i4")], ["zone"], **how)
    (folder / "zones.csv").write_text("zone,mean_radius\n1,0.25\n2,0.5\n")
    return {"zones": "zones.shp", "table": "zones.csv"}


PLACE = Affine(5.0, 0.0, 0.0, 0.0, -5.0, 400.0)


@pytest.mark.family(5)
@pytest.mark.parametrize("memory", [None, 20_000])
@pytest.mark.parametrize(
    ("change", "what"),
    [(change_statistics, "dem"), (change_mask, "dem"), (change_table, "surface")],
)
def test_what_lies_beside_a_file_is_known_by_what_was_read(tmp_path, change, what, memory):
    if change is change_table and memory:
        pytest.skip("polygons need the whole terrain")
    make_raster(tmp_path / "tile.tif", rough().astype("f4"), PLACE, None)
    output = {"maps": ["passages"]}
    case = case_in(tmp_path, output=output, **place()).replace(terrain={"dem": "tile.tif"})
    if change is change_table:
        case = case.replace(surface={"uniform_mean_radius": None, **make_shapefile(tmp_path)})
    paths = [tmp_path / f"{k}.nc" for k in (1, 2)]
    for k, path in enumerate(paths, start=1):
        rockfall.write_result(rockfall.run(case, shard=(k, 2), memory=memory), path)
        if k == 1:
            change(tmp_path)
    with refused(f"{paths[1]}: belongs to a different run than {paths[0]}: its {what} differs"):
        rockfall.merge(paths)


def test_a_run_does_not_go_on_with_other_elevations_of_the_same_file(tmp_path):
    make_raster(tmp_path / "tile.tif", rough().astype("f4"), PLACE, None)
    case = case_in(tmp_path, **place()).replace(terrain={"dem": "tile.tif"})
    run_scene(read_scene(case), checkpoint=Checkpoint(tmp_path / "c", 0.0), chunk=100)
    change_statistics(tmp_path)
    with pytest.raises(rockfall.RockfallError, match=r"belongs to a different run \(dem differs\)"):
        run_scene(read_scene(case), checkpoint=Checkpoint(tmp_path / "c", 0.0))


def test_sums_of_what_was_read_do_not_depend_on_windows_or_formats(tmp_path):
    z = rough().astype("f4")
    make_raster(tmp_path / "tile.tif", z, PLACE, None)
    case = case_in(tmp_path, output={"maps": ["passages"]}, **place())
    case = case.replace(terrain={"dem": "tile.tif"})
    known = [read_scene(case, memory=memory).decoded for memory in (None, 20_000, 9_000)]
    known.append(read_scene(case, dem=z, transform=grid(z)).decoded)
    assert all(one == known[0] for one in known)
    shifted = read_scene(case, dem=z, transform=grid(z, west=1.0)).decoded
    assert {key for key in shifted if shifted[key] != known[0][key]} == {"dem"}
