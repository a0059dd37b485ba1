# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall dem` with points on a grid: makes exactly this grid, without interpolation; shifted
columns are refused."""

from pathlib import Path

import numpy as np
import pytest

from made import PLACE
from programs import refuses
from rockfall.cli import main
from rockfall.draft.dem import dem_of_points
from rockfall.io.rasters.dem import read_dem

NX, NY = 30, 20
W, N = PLACE.c, PLACE.f - NY  # north-west corner, in UTM zone 32
Z = np.random.default_rng(5).uniform(1000, 1100, (NY, NX)).round(2)


def nodes(step=1.0, first=0.5, z=Z):
    """Points of a grid row by row from the north-west. The first is `first` cells from corner (W,
    N) in x and y."""
    rows, columns = np.indices(z.shape)
    x, y = W + (columns + first) * step, N - (rows + first) * step
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def without(*where):
    z = Z.copy()
    for part in where:
        z[part] = np.nan
    return z


def kept(z):
    points = nodes(z=z)
    return points[~np.isnan(points[:, 2])]


def jitter(points, size, seed=2):
    points = points.copy()
    points[:, :2] += np.random.default_rng(seed).uniform(-size, size, (len(points), 2))
    return points


SHUFFLED = np.random.default_rng(1).permutation(NX * NY)
HOLES = without(np.random.default_rng(3).random(Z.shape) < 0.25)
POLYGON = without(np.add.outer(np.arange(NY), np.arange(NX)) > 30)
STRIPES = without((slice(7, 12), slice(None)), (slice(None), 9))
ISLANDS = without((slice(None), slice(4, 28)))
#: Points and their grid: elevations, spacing, and the first node in steps from the corner.
REGULAR = {
    "centres": (nodes(), Z, 1.0, 0.5),
    "corners": (nodes(first=0.0), Z, 1.0, 0.0),
    "off both": (nodes(first=0.25), Z, 1.0, 0.25),
    "from the south": (nodes()[::-1], Z, 1.0, 0.5),
    "by columns": (nodes().reshape(NY, NX, 3).transpose(1, 0, 2).reshape(-1, 3), Z, 1.0, 0.5),
    "in any order": (nodes()[SHUFFLED], Z, 1.0, 0.5),
    "fine": (nodes(0.25), Z, 0.25, 0.5),
    "coarse": (nodes(25.0, 0.0), Z, 25.0, 0.0),
    "thirds, in millimetres": (nodes(1 / 3).round(3), Z, 1 / 3, 0.5),
    "rounded to decimetres": (jitter(nodes(5.0), 0.05).round(1), Z.round(1), 5.0, 0.5),
    "twice, as at seams": (np.concatenate([nodes(), nodes()[:90]]), Z, 1.0, 0.5),
    "random gaps": (kept(HOLES), HOLES, 1.0, 0.5),
    "cut by a border": (kept(POLYGON), POLYGON, 1.0, 0.5),
    "no rows there": (kept(STRIPES), STRIPES, 1.0, 0.5),
    "two tiles apart": (kept(ISLANDS), ISLANDS, 1.0, 0.5),
    "two columns": (nodes(z=Z[:, :2]), Z[:, :2], 1.0, 0.5),
}


def write(path, points):
    path.write_text("".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in points.tolist()))
    return path


@pytest.mark.parametrize("what", REGULAR)
def test_nodes_become_their_grid_unchanged(what, tmp_path):
    points, z, step, first = REGULAR[what]
    dem, survey = dem_of_points(write(tmp_path / "a.xyz", points))
    assert survey.nodes is not None and survey.nodes.gaps == np.isnan(z).sum()
    np.testing.assert_array_equal(dem.z, z.astype("f4"))
    assert dem.grid.cell == pytest.approx(step, rel=1e-4)
    assert dem.grid.x[0] == pytest.approx(W + first * step, abs=0.02 * step)
    assert dem.grid.y[0] == pytest.approx(N - first * step, abs=0.02 * step)
    assert dem.grid.x[-1] == pytest.approx(W + (z.shape[1] - 1 + first) * step, abs=0.02 * step)


@pytest.mark.parametrize("name", ["points.csv", "points.txt", "grid.asc", "rows.dat", "a.xyz"])
def test_every_file_of_rows_says_what_it_became(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    mark = {"points.csv": ";", "grid.asc": ";"}.get(name, " ")
    rows = [mark.join(map(repr, row)) for row in kept(STRIPES).tolist()]
    head = [] if name == "grid.asc" else [mark.join("xyz")]
    Path(name).write_text("\n".join([*head, *rows]))
    assert main(["dem", name, "-o", "dem.tif", "--crs", "EPSG:32632"]) == 0
    said = capsys.readouterr()
    gaps = int(np.isnan(STRIPES).sum())
    assert "steeper than 8" in said.err and said.err.count("\n") == 1  # elevations are random
    assert "nodes of a grid of 30 x 20, 1 m apart" in said.out
    assert "nodes used unchanged as cell centres (corner of the grid 600000, 4999980)" in said.out
    assert f"{gaps} nodes without a point are nodata" in said.out
    z, grid = read_dem("dem.tif")
    np.testing.assert_array_equal(z, STRIPES.astype("f4"))
    assert (grid.west, grid.north, grid.cell) == (W, N, 1.0)


def test_points_marked_as_nodata_are_gaps(tmp_path):
    z = np.where(np.isnan(HOLES), -9999.0, HOLES)
    dem, survey = dem_of_points(write(tmp_path / "a.xyz", nodes(z=z)))
    np.testing.assert_array_equal(dem.z, HOLES.astype("f4"))
    assert "points with elevation -9999 are omitted as nodata" in survey.remarks[0]


def test_gaps_are_filled_where_asked_and_nodes_stay(tmp_path):
    dem, _ = dem_of_points(write(tmp_path / "a.xyz", kept(HOLES)), within=3.0)
    known = ~np.isnan(HOLES)
    np.testing.assert_array_equal(dem.z[known], HOLES.astype("f4")[known])
    assert not np.isnan(dem.z).any()


@pytest.mark.parametrize("cell", [0.5, 0.7, 2.0, 3.0])
def test_a_plane_stays_a_plane_to_its_edges_on_other_cells(cell, tmp_path):
    plane = 1000 + np.add.outer(-0.5 * np.arange(NY), 0.25 * np.arange(NX))
    dem, _ = dem_of_points(write(tmp_path / "a.xyz", nodes(z=plane)), cell=cell)
    x, y = np.meshgrid(dem.grid.x, dem.grid.y)
    wanted = 1000 - 0.5 * (N - 0.5 - y) + 0.25 * (x - W - 0.5)
    np.testing.assert_allclose(dem.z, wanted, rtol=0, atol=1e-3)
    assert dem.grid.cell == cell
    assert min(x.min() - W - 0.5, N - 0.5 - y.max()) >= -1e-9
    assert max(x.min() - W - 0.5, W + NX - 0.5 - x.max()) < cell


def turned(points, degrees):
    middle, angle = points.mean(axis=0), np.radians(degrees)
    (u, v), (c, s) = (points - middle)[:, :2].T, (np.cos(angle), np.sin(angle))
    return np.column_stack([c * u - s * v, s * u + c * v, points[:, 2]]) + (*middle[:2], 0)


def rounded_survey():
    """One in twelve of the points of a grid of 1 m, in random order."""
    rows = np.random.default_rng(7).choice(NX * NY, NX * NY // 12, replace=False)
    return nodes()[rows]


SCATTERED = {
    "a survey on whole metres": rounded_survey(),
    "every other, as on a chessboard": nodes()[np.indices(Z.shape).sum(axis=0).ravel() % 2 == 0],
    "turned": turned(nodes(), 20.0),
    "profiles": nodes().reshape(NY, NX, 3)[::7].reshape(-1, 3),
    "anywhere": jitter(nodes(), 0.4),
}


@pytest.mark.parametrize("what", SCATTERED)
def test_other_points_are_interpolated(what, tmp_path):
    dem, survey = dem_of_points(write(tmp_path / "a.xyz", SCATTERED[what]))
    assert survey.nodes is None and len(survey.errors) == len(SCATTERED[what])
    assert dem.grid.cell <= survey.spacing
    assert any("not square" in line for line in survey.remarks) == (what == "profiles")


ROWS = [(W + 10.0 * i, N - 10.0 * j, 812.0 + i + j) for j in range(4) for i in range(5)]
SLIPPED = {
    "an index without a name": ("x y z", "{n} {x} {y} {z}", "line 2: more than the 3 columns"),
    "rows longer than the head": ("x;y;z", "{x};{y};{z};7", "line 2: more than the 3 columns"),
    "a longer row later": ("", "{x} {y} {z}{more}", "line 8: more than the 3 columns"),
    "an index and no head": ("", "{n} {x} {y} {z}", "the first column is a row number"),
    "an index from 0": ("", "{n0},{x},{y},{z}", "the first column is a row number"),
    "elevations first": ("", "{z} {x} {y}", "line 1: the third column, 4999980, is no"),
    "elevations between": ("", "{x} {z} {y}", "line 1: the third column, 4999980, is no"),
    "a number and no head": (
        "",
        "17 {x} {y} {z}",
        "line 1: the third column, 4999980, is no",
    ),
    "decimal commas": ("", "{x},5 {y},5 {z},5", "line 1: has decimal commas: use decimal points"),
    "decimal commas in cells": ("", "{x},5;{y},5;{z},5", "line 1: has decimal commas: use"),
    "north first": ("", "{y} {x} {z}", "x 4999980, y 600000 look exchanged: name the columns"),
    "north named x": ("y x z", "{x} {y} {z}", "x 4999965, y 600020 lies outside EPSG:32632"),
}


@pytest.mark.parametrize("what", SLIPPED)
def test_columns_that_slip_are_refused(what, tmp_path, monkeypatch, capsys):
    head, form, said = SLIPPED[what]
    lines = [head] if head else []
    for n, (x, y, z) in enumerate(ROWS):
        lines.append(
            form.format(n=n + 1, n0=n, x=int(x), y=int(y), z=int(z), more=" 3" if n == 7 else "")
        )
    monkeypatch.chdir(tmp_path)
    Path("a.xyz").write_text("\n".join(lines))
    refuses(["dem", "a.xyz", "-o", "dem.tif", "--crs", "EPSG:32632"], f"a.xyz: {said}.*", capsys)


def test_north_before_east_without_names_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write(Path("a.xyz"), np.array(ROWS)[:, [1, 0, 2]])
    words = (
        "a.xyz: x 4999980, y 600000 look exchanged: name the columns in a first line, such as .*"
    )
    refuses(["dem", "a.xyz", "-o", "dem.tif"], words, capsys)


def test_rounded_places_are_refused_and_degrees_are_remarked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    points = nodes()
    rows = [f"{x:g} {y:g} {z:g}\n" for x, y, z in points.tolist()]
    Path("a.xyz").write_text("".join(["x y z\n", *rows]))
    words = "a.xyz: 600 points at 48 different places: are x and y rounded[?]"
    refuses(["dem", "a.xyz", "-o", "dem.tif"], words, capsys)
    points[:, :2] = (7, 46) + (points[:, :2] - (W, N)) / 1e5
    write(Path("b.xyz"), points)
    assert main(["dem", "b.xyz", "-o", "dem.tif"]) == 0
    assert "coordinates look like degrees (x " in capsys.readouterr().err


def test_a_grid_in_a_txt_is_a_raster(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    head = "ncols 3\nnrows 2\nxllcorner 600000\nyllcorner 4999990\ncellsize 5\n"
    Path("dem.txt").write_text(f"{head}1 2 3\n4 5 6\n")
    assert main(["dem", "dem.txt", "-o", "dem.tif", "--crs", "EPSG:32632"]) == 0
    np.testing.assert_array_equal(read_dem("dem.tif")[0], [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("head", "form"),
    [
        (",x,y,z", "{n},{x},{y},{z}"),
        ("fid x y h z", "{n} {x} {y} 3 {z}"),
        ("// x y z", "{x} {y} {z}"),
        ("x;y;z", "{x};{y};{z};"),
        ("", "{x} {y} {z} 255 0"),
        ('"x" "y" "z"', "{x} {y} {z}"),
        ("X [m];Y [m];Z [m]", "{x};{y};{z}"),
        ("Z,Y,X", "{z},{y},{x}"),
    ],
)
def test_columns_with_names_are_taken_by_them(head, form, tmp_path):
    lines = [head] if head else []
    lines += [form.format(n=n, x=x, y=y, z=z) for n, (x, y, z) in enumerate(ROWS)]
    (tmp_path / "a.xyz").write_text("\n".join(lines))
    dem, _ = dem_of_points(tmp_path / "a.xyz")
    np.testing.assert_array_equal(dem.z.ravel(), [z for *_, z in ROWS])


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("shift", "crs", "said"),
    [
        ((0, 0, 9000), "EPSG:32632", "elevations from 9812 to 9819 m, but land lies between"),
        ((0, 0, -2000), "EPSG:32632", "elevations from -1188 to -1181 m, but land lies between"),
        ((2e6, -3.8e6, 0), "EPSG:32632", "is outside the area of use of EPSG:32632"),
        ((0, 0, 0), "EPSG:2056", "x 600020, y 4999965 is outside the area of use of EPSG:2056"),
        ((0, 0, 0), "EPSG:25832", ""),
        ((0, 0, -1200), "EPSG:32632", ""),
    ],
)
def test_places_and_heights_that_hardly_can_be_are_remarked(
    shift, crs, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    rows = (np.array(ROWS) + shift).tolist()
    Path("a.xyz").write_text("x y z\n" + "\n".join(" ".join(map(repr, row)) for row in rows))
    assert main(["dem", "a.xyz", "-o", "dem.tif", "--crs", crs]) == 0
    err = capsys.readouterr().err
    assert err.count("\n") == bool(said) and said in err
