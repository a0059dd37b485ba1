# SPDX-License-Identifier: BSD-3-Clause
"""Rockyfor3D folders run without changes, and each of their files has its effect."""

import re
from pathlib import Path

import numpy as np
import pytest

import rockfall
from made import refused, write_ascii
from programs import everything, find_program, run_program, same_results
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.io.output_files import overwriting
from rockfall.result.crossings import at_lines
from rockfall.rockyfor3d import nets
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.studies.model_scenes import ROCKS
from rockfall.studies.models import run_models
from rockfall.text.preview import preview
from scenes import grid, status

NY, NX, CELL = 50, 40, 5.0
#: Row and column of the sources, and shape, density, sides, volume of their boulders.
SOURCES = {
    (5, 12): (1, 2600.0, (0.5, 0.8, 1.5), 0.5 * 0.8 * 1.5),
    (5, 27): (2, 2900.0, (1.0, 1.2, 1.4), np.pi / 6 * 1.0 * 1.2 * 1.4),
}
BOULDERS = 60  # boulders from each source


def layers():
    """Rasters of a folder by name: a slope of 40 degrees above a flat, soil 4 above soil 3, and
    some sources."""
    y = (np.arange(NY)[::-1] + 0.5) * CELL
    z = np.repeat(np.interp(y, [0, 60, 250], [95, 100, 260])[:, None], NX, 1)
    found = {"dem": z, **{name: np.zeros(z.shape) for name in ("rockdensity", "blshape")}}
    found |= {
        name: np.full(z.shape, size)
        for name, size in zip(
            ("d1", "d2", "d3", "rg70", "rg20", "rg10"), (9.0, 9.0, 9.0, 0.05, 0.1, 0.2), strict=True
        )
    }
    for place, (shape, density, sides, _) in SOURCES.items():
        found["blshape"][place], found["rockdensity"][place] = shape, density
        for name, side in zip(("d1", "d2", "d3"), sides, strict=True):
            found[name][place] = side
    found["soiltype"] = np.where(np.arange(NY) < 30, 4.0, 3.0)[:, None] + np.zeros(NX)
    return found


def forest():
    """Rasters of a forest with two stems in each cell of ten rows."""
    stems = np.zeros((NY, NX))
    stems[15:25] = 2
    return {
        "nrtrees": stems, "dbhmean": np.full(stems.shape, 12.0),
        "dbhstd": np.full(stems.shape, 2.0), "conif_percent": np.full(stems.shape, 70.0),
    }  # fmt: skip


def net(energy=5000.0, height=9.0):
    number = np.zeros((NY, NX))
    number[35] = 7
    return {"net_number": number, "net_energy": energy * (number > 0),
            "net_height": height * (number > 0)}  # fmt: skip


def make_folder(path, **rasters):
    path.mkdir(parents=True)
    for name, values in (layers() | rasters).items():
        if values is not None:
            write_ascii(path / f"{name}.asc", np.asarray(values, float), grid(values, CELL))
    return path


def imported(folder, **rasters):
    """Case imported from a folder with these rasters, with few boulders."""
    rockfall.import_rockyfor3d(make_folder(folder / "rocky", **rasters), folder / "case")
    case = rockfall.read_case(folder / "case/case.nml")
    return case.replace(case={"boulders": BOULDERS, "threads": 1})


# ---- effects of the files


def test_each_source_has_boulders_of_its_own(tmp_path):
    line = [{"name": "L", "x": [0.0, 200.0], "y": [210.0, 210.0]}]
    result = rockfall.run(imported(tmp_path).replace(line=line, output={"energy_balance": True}))
    for k, (_, density, _, volume) in enumerate(SOURCES.values()):
        mine = slice(k * BOULDERS, (k + 1) * BOULDERS)
        assert np.allclose(result.volume[mine], volume, rtol=1e-14)
        speed, energy = (
            at_lines(result)[f"line_{name}"][0, mine] for name in ("speed", "energy_translational")
        )
        crossed = speed > 0
        assert crossed.sum() > 10
        masses = (2 * energy / speed**2)[crossed]
        assert np.allclose(masses, density * volume, rtol=1e-12)
        assert np.allclose(result.mass[mine], density * volume, rtol=1e-15)
        released = result.energy_released[mine]
        parts = sum(
            result[f"energy_{name}"][mine] for name in ("ground", "trees", "barriers", "left")
        )
        assert np.allclose(released, parts, rtol=1e-12)


def test_the_density_of_the_case_where_no_raster_says_it(tmp_path):
    case = imported(tmp_path, soiltype=None).replace(output={"energy_balance": True})
    light, heavy = (
        rockfall.run(case.replace(boulder={"rock_density": None, "density": density}))
        for density in (1500.0, 3000.0)
    )  # by impact sets, mass does not change paths
    assert np.allclose(heavy.energy_released, 2 * light.energy_released, rtol=1e-12)


def test_volumes_vary_by_a_fraction(tmp_path):
    case = imported(tmp_path).replace(boulder={"volume_spread": 0.2}, case={"boulders": 2000})
    case = case.replace(output={"maps": None}, impact={"impact_limit": 1})
    factors = rockfall.run(case).volume.values.reshape(2, -1)
    factors = factors / np.array([[volume] for *_, volume in SOURCES.values()])
    assert factors.min() >= 0.8 and factors.max() <= 1.2
    assert np.allclose(factors.mean(axis=1), 1, atol=4 * 0.4 / np.sqrt(12 * 2000))


def test_soil_types_are_grounds(tmp_path):
    case = imported(tmp_path)
    assert case.surface["ground_map"] == "../rocky/soiltype.asc"
    result = rockfall.run(case)
    counts = dict(zip(result.ground.values, result.rebounds_by_ground.values, strict=True))
    assert counts["soil_4"] > 0 and counts["soil_3"] > 0
    assert counts["soil_4"] + counts["soil_3"] == result.rebounds


def test_without_soil_types_the_impact_sets_hold(tmp_path):
    case = imported(tmp_path, soiltype=None)
    assert "ground_map" not in case.surface
    assert "ground" not in rockfall.run(case).dims


def test_a_river_absorbs(tmp_path):
    soil = layers()["soiltype"]
    soil[20] = 0
    result = rockfall.run(imported(tmp_path, soiltype=soil))
    assert "absorbed" in status(result)


def test_trees_stand_where_and_as_many_as_the_rasters_say(tmp_path):
    case = imported(tmp_path, **forest())
    trees = read_scene(case).trees
    assert trees.x.size == 2 * 10 * NX
    assert trees.y.min() >= CELL * (NY - 25) and trees.y.max() <= CELL * (NY - 15)
    assert abs(trees.dbh.mean() - 12) < 4 * 2 / np.sqrt(trees.x.size)
    result = rockfall.run(case.replace(output={"energy_balance": True}))
    assert result.trees_hit.sum() > 0 and result.energy_trees.sum() > 0


def test_a_list_of_trees(tmp_path):
    folder = make_folder(tmp_path / "rocky", **forest())
    rows = "X Y DBH\n62.5\t150.0\t30\n\n137.5;150.5;31.5\n9,8.5,7, fir\n"
    (folder / "Treefile.txt").write_text(rows)
    (folder / "trees_2010.csv").write_text("1 2 3\n")
    notes = rockfall.import_rockyfor3d(folder, tmp_path / "case")
    assert notes[:3] == [
        "Treefile.txt: columns after x, y and DBH are left out",
        "nrtrees.asc: left out, Treefile.txt lists the trees",
        "trees_2010.csv: unknown file, left out",
    ]
    trees = read_scene(rockfall.read_case(tmp_path / "case/case.nml")).trees
    found = [[62.5, 137.5, 9], [150, 150.5, 8.5], [30, 31.5, 7]]
    assert np.array_equal([trees.x, trees.y, trees.dbh], found)


def test_nets_stop_boulders(tmp_path):
    case = imported(tmp_path, **net())
    (one,) = case.barrier
    assert (one["name"], one["height"], one["capacity"]) == ("net 7", 9.0, 5000.0)
    assert (one["x"], one["y"]) == ([0.0, 200.0], [72.5, 72.5])
    stopped = status(rockfall.run(case)).count("stopped_by_barrier")
    assert stopped > BOULDERS / 2
    weak = imported(tmp_path / "weak", **net(energy=0.001))
    assert "stopped_by_barrier" not in status(rockfall.run(weak))


def test_sources_of_shape_0_have_no_boulders(tmp_path):
    shape = layers()["blshape"]
    shape[5, 12] = 0
    case = imported(tmp_path, blshape=shape)
    scene = read_scene(case)
    assert scene.x.tolist() == [27.5 * CELL]
    assert scene.remarks == ("&boulder shape: 0 at 1 of 2 sources, which release nothing",)
    assert "mass 2,550 kg" in preview(scene)


def test_without_shapes_all_are_spheres(tmp_path):
    volumes = rockfall.run(imported(tmp_path, blshape=None)).volume.values[[0, -1]]
    sides = np.array([sides for _, _, sides, _ in SOURCES.values()])
    assert np.allclose(volumes, np.pi / 6 * sides.mean(axis=1) ** 3, rtol=1e-14)


def test_densities_that_are_no_integers(tmp_path):
    density = layers()["rockdensity"]
    density[5, 12] = 2600.5
    case = imported(tmp_path, rockdensity=density)
    assert case.release["cells"] == "sources.tif"
    assert read_scene(case).source_boulders.density.tolist() == [2600.5, 2900.0]


# ---- nets as lines


@pytest.mark.parametrize(
    ("cells", "x", "y"),
    [
        ([(2, 1), (2, 2), (2, 3)], [5, 20], [12.5, 12.5]),
        ([(1, 2), (2, 2), (3, 2)], [12.5, 12.5], [20, 5]),
        ([(1, 1), (2, 2), (3, 3)], [5, 20], [20, 5]),
        ([(3, 1), (3, 2), (2, 3), (1, 4)], [5, 25], [7.5, 20]),
        ([(2, 2)], [10, 15], [12.5, 12.5]),
    ],
    ids=["row", "column", "diagonal", "stairs", "one cell"],
)  # fmt: skip
def test_the_line_of_a_net(cells, x, y):
    dem = np.repeat(np.arange(5.0)[::-1, None], 5, 1)
    way = nets.longest_way(np.array(cells))
    found = np.array(nets.centre_line(way, grid(dem, CELL), dem))
    if found[0, 0] > found[0, -1] or (x[0] == x[-1] and found[1, 0] < found[1, -1]):
        found = found[:, ::-1]
    assert np.allclose(found, [x, y])


def test_the_line_of_a_net_has_no_stairs():
    """A straight net at any angle has two points, and passes through its cells."""
    dem = np.zeros((60, 60))
    for rise in (0.1, 0.3, 0.5, 0.77, 1.0):
        columns = np.arange(5, 40)
        cells = np.unique(np.column_stack([np.rint(5 + rise * (columns - 5)), columns]), axis=0)
        way = nets.longest_way(cells.astype(int))
        x, y = nets.centre_line(way, grid(dem, CELL), dem)
        assert len(x) == 2, rise
        row, column = (60 * CELL - np.array(y)) / CELL - 0.5, np.array(x) / CELL - 0.5
        along = np.array([np.diff(row)[0], np.diff(column)[0]])
        off = (way - [row[0], column[0]]) @ [-along[1], along[0]] / np.hypot(*along)
        assert np.abs(off).max() <= nets.TOLERANCE
    corner = np.array([(20, k) for k in range(5, 20)] + [(k, 20) for k in range(19, 4, -1)])
    assert len(nets.centre_line(nets.longest_way(corner), grid(dem, CELL), dem)[0]) > 2


def test_the_coordinate_system_of_a_folder_is_given(tmp_path):
    """Results have the CRS given by --crs; with an invalid CRS nothing is written."""
    folder, out = make_folder(tmp_path / "rocky"), tmp_path / "case"
    assert main(["import-rockyfor3d", str(folder), "-o", str(out), "--crs", "EPSG:2056"]) == 0
    case = rockfall.read_case(out / "case.nml")
    found = rockfall.run(case.replace(case={"boulders": 2}))
    assert "CH1903+ / LV95" in found["crs"].attrs["crs_wkt"]
    rockfall.import_rockyfor3d(folder, tmp_path / "plain")
    plain = rockfall.run(rockfall.read_case(tmp_path / "plain/case.nml").replace(
        case={"boulders": 2}
    ))  # fmt: skip
    assert np.array_equal(plain["stop_x"], found["stop_x"])
    with pytest.raises(RockfallError, match="--crs EPSG:1: is not a known CRS"):
        rockfall.import_rockyfor3d(folder, tmp_path / "none", crs="EPSG:1")
    assert not (tmp_path / "none").exists()


def test_parts_of_a_net_are_barriers_of_their_own(tmp_path):
    rasters = net()
    for values in rasters.values():
        values[35, 18:22] = 0
    names = [one["name"] for one in imported(tmp_path, **rasters).barrier]
    assert names == ["net 7 part 1", "net 7 part 2"]


def test_branches_of_a_net_are_told(tmp_path):
    rasters = net()
    for values in rasters.values():
        values[36:40, 20] = values[35, 20]  # its first cell touches the line
    folder = make_folder(tmp_path / "rocky", **rasters)
    note, *_ = rockfall.import_rockyfor3d(folder, tmp_path / "case")
    assert note == (
        "net_number.asc: net 7: 3 cells branch off its line and stop nothing: "
        "give them a separate number"
    )


def test_what_the_model_is_worth_is_said_of_the_case_that_is_made(tmp_path):
    """Limits of the rebound and forest models are printed and written to the case; a folder without
    soil types and trees has none."""
    folder = make_folder(tmp_path / "rocky", **forest())
    text = " ".join(rockfall.import_rockyfor3d(folder, tmp_path / "case"))
    for said in (
        "rebounds follow the classical model rockyfor3d of the shipped grounds, not the impact",
        "without calibration at the site, speeds and energies may be too low",
        "forest model is not validated:",
    ):
        assert said in text and said in (tmp_path / "case/case.nml").read_text()
    bare = make_folder(tmp_path / "bare", soiltype=None)
    text = " ".join(rockfall.import_rockyfor3d(bare, tmp_path / "other"))
    assert "confirmed" not in text and "validated" not in text


def test_models_vary_the_soils_that_cover_all_of_an_import(tmp_path):
    """Impact sets apply where rocks have a size; smooth ground and obstacles that absorb keep their
    soil."""
    rg = np.full((NY, NX), 0.2)
    rg[:, :8], rg[-3:] = 0.0, 100.0
    line = [{"name": "L", "x": [0.0, 200.0], "y": [150.0, 150.0]}]
    case = imported(tmp_path, rg70=rg, rg20=rg, rg10=rg).replace(line=line)
    found = run_models(case)
    assert found.names[:3] == ("grounds of the case", "impact sets, method A", "rockyfor3d")
    assert found.names[2:] == tuple(ROCKS)
    part = 100 * (NX - 8) * (NY - 3) / (NX * NY)
    note = f"impact sets cover {part:.1f} % of the terrain, and grounds of the case cover the rest"
    assert note in found.notes
    table = found.table.set_index(["model", "line", "quantity", "statistic"])["value"]
    own, by_sets = (table[name, "L", "energy_total", "q95"] for name in found.names[:2])
    assert own == pytest.approx(
        rockfall.line_statistics(rockfall.run(case)).set_index("quantity")["q95"]["energy_total"]
    )
    assert by_sets > 2 * own  # spread that the import alone does not show


# ---- both programs


@pytest.mark.all
@pytest.mark.skipif(find_program() is None, reason="the standalone program is not built")
def test_both_programs_give_the_same_bits(tmp_path):
    case = imported(tmp_path, **forest(), **net())
    case = case.replace(boulder={"volume_spread": 0.1}, output={"energy_balance": True})
    prepare(case, tmp_path / "ready")
    done = run_program("case.nml", "-o", "part.nc", cwd=tmp_path / "ready")
    assert done.returncode == 0, done.stderr
    assert main(["merge", str(tmp_path / "ready/part.nc"), "-o", str(tmp_path / "out.nc")]) == 0
    same_results(rockfall.read_result(tmp_path / "out.nc"), rockfall.run(case))


# ---- the command


def test_the_command_says_what_it_left(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = make_folder(
        tmp_path / "rocky",
        soiltype=None,
        other=np.zeros((NY, NX)),
        **{**forest(), "conif_percent": None, "dbhstd": None},
    )
    before = everything(folder)
    for again in [], ["--overwrite"]:
        assert main(["import-rockyfor3d", "rocky", "-o", "case", *again]) == 0
        out = capsys.readouterr().out
    assert everything(folder) == before
    for words in "soiltype.asc is missing", "dbhstd.asc is missing", "other.asc: unknown file", \
            "conif_percent.asc is missing", "heights are normal":  # fmt: skip
        assert re.search(rf"^  .*{words}", out, re.M), words
        assert words in Path("case/case.nml").read_text()
    assert out.endswith(f"\n{Path('case/case.nml')}\n")
    assert sorted(one.name for one in Path("case").iterdir()) == ["case.nml", "stems.tif"]


def test_a_folder_may_hold_its_own_case(tmp_path):
    folder = make_folder(tmp_path / "rocky")
    rockfall.import_rockyfor3d(folder, folder)
    assert rockfall.read_case(folder / "case.nml").terrain["dem"] == "dem.asc"


# ---- what is refused


NEEDED = "dem.asc, rockdensity.asc, d1.asc, d2.asc, d3.asc, rg70.asc, rg20.asc, rg10.asc"


@pytest.mark.parametrize(
    ("rasters", "words"),
    [
        ({"d2": None, "rg10": None},
         f"d2.asc, rg10.asc missing: a Rockyfor3D folder requires {NEEDED}"),
        ({"rockdensity": np.zeros((NY, NX))},
         "rockdensity.asc: no source cells: at least one cell must be above zero"),
        (net(height=0.0),
         "net_height.asc: net 7 has cells that are not > 0: give every cell of net_number an "
         "energy [kJ] and a height [m]"),
    ],
)  # fmt: skip
def test_folders_that_cannot_be_imported(tmp_path, rasters, words):
    folder = make_folder(tmp_path / "rocky", **rasters)
    with pytest.raises(RockfallError) as caught:
        rockfall.import_rockyfor3d(folder, tmp_path / "case")
    assert "\n" not in str(caught.value) and str(caught.value).endswith(words)
    assert not (tmp_path / "case").exists()


def test_no_folder(tmp_path):
    with refused(f"{tmp_path / 'no'}: no such folder"):
        rockfall.import_rockyfor3d(tmp_path / "no", tmp_path / "case")


def test_a_case_of_someone_else_is_not_overwritten(tmp_path):
    folder = make_folder(tmp_path / "rocky")
    (folder / "case.nml").write_text("&case /")
    words = "already exists; not overwritten (--overwrite replaces it)"
    with overwriting(False), refused(f"{folder / 'case.nml'}: {words}"):
        rockfall.import_rockyfor3d(folder, folder)
    assert (folder / "case.nml").read_text() == "&case /"


@pytest.mark.parametrize("row", ["1 2", "1,5;2,5;30", "1,5 2,5 30,5", "1 2 nan"])
def test_rows_that_are_no_trees(tmp_path, row):
    """Rows that are not three numbers are refused; decimal commas would split a number in two."""
    folder = make_folder(tmp_path / "rocky")
    (folder / "trees.txt").write_text(f"x y dbh\n{row}\n")
    words = "line 2: must be x, y and DBH [cm], with decimal points"
    with refused(f"{folder / 'trees.txt'}: {words}"):
        rockfall.import_rockyfor3d(folder, tmp_path / "case")


@pytest.mark.parametrize(
    ("rasters", "words"),
    [
        ({"d1": -layers()["d1"]},
         "d1.asc: -0.5 at the source 62.5, 222.5: must be > 0 and at most 1000 m"),
        ({"d3": np.full((NY, NX), np.nan)},
         "d3.asc: no data at the source 62.5, 222.5: must be > 0 and at most 1000 m"),
        ({"blshape": layers()["blshape"] + 3},
         "blshape.asc: 5 at the source 137.5, 222.5: must be 0 to 4"),
        ({"blshape": np.zeros((NY, NX))},
         "blshape.asc: is 0 at all sources, so no boulder is released"),
        ({"soiltype": np.full((NY, NX), 9.0)}, None),
    ],
)  # fmt: skip
def test_values_that_no_boulder_has(tmp_path, rasters, words):
    with pytest.raises(RockfallError) as caught:
        rockfall.run(imported(tmp_path, **rasters))
    assert "\n" not in str(caught.value) and str(caught.value).endswith(words or "")


@pytest.mark.parametrize("name", ["rockdensity", "d1", "blshape"])
def test_sizes_of_boulders_are_not_interpolated(tmp_path, name):
    """A raster on other cells is refused with a command that resamples without interpolation."""
    raster = layers()[name][1:]
    with pytest.raises(RockfallError, match=r"are not on the cells .* --resampling nearest$"):
        read_scene(imported(tmp_path, **{name: raster}))


@pytest.mark.parametrize(
    ("boulder", "words"),
    [
        ({"volume": "source"}, "&boulder d1 is missing: needed for volume = 'source'"),
        ({"volume_mean": 1.0, "d1": "a.tif"},
         "&boulder d1 = 'a.tif': is not valid for volume = 'fixed'"),
        ({"volume_mean": 1.0, "volume_spread": 0.1},
         "&boulder volume_spread = 0.1: is not valid for volume = 'fixed'"),
    ],
)  # fmt: skip
def test_keys_that_do_not_go_together(boulder, words):
    with pytest.raises(RockfallError, match=re.escape(words)):
        rockfall.Case(
            case={"boulders": 1}, surface={"uniform_mean_radius": 1.0}, boulder=boulder,
            release={"x": [0.0], "y": [0.0]},
        )  # fmt: skip
