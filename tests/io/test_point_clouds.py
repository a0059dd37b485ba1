# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds: all points of a file are read exactly, and none is silently lost."""

import struct
import time

import numpy as np
import pyproj
import pytest

from made import refused
from rockfall.cli import main
from rockfall.draft.dem import dem_of_points
from rockfall.errors import RockfallError
from rockfall.io.rasters.dem import read_dem
from rockfall.io.vectors.point_clouds import read_clouds

laspy = pytest.importorskip("laspy", reason="the points extra is not installed")
pytest.importorskip("lazrs", reason="the points extra is not installed")

W, S = 2600000.0, 1200000.0


def places(n=3000, seed=1):
    """Random points rounded to a hundredth of a metre, as the files store them."""
    drawn = np.random.default_rng(seed).uniform((W, S, 500), (W + 60, S + 40, 520), (n, 3))
    return np.round(drawn, 2)


def cloud(path, points, classes=2, crs=2056, withheld=None, version="1.4", kind=6):
    header = laspy.LasHeader(point_format=kind, version=version)
    header.scales, header.offsets = [0.01] * 3, [W, S, 0]
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.classification = np.broadcast_to(classes, len(points))
    if withheld is not None:
        las.withheld = withheld
    las.write(path)
    return path


def by_hand(points, classes):
    """Content of a LAS file of version 1.2, made from the standard without laspy."""
    scale, offset = (0.01, 0.01, 0.01), (W, S, 0.0)
    head = struct.pack(
        "<4sHHIHH8sBB32s32sHHHIIBHI20x12d", b"LASF", 0, 0, 0, 0, 0, b"", 1, 2, b"", b"by hand", 1,
        2026, 227, 227, 0, 0, 20, len(points), *scale, *offset, *[0.0] * 6,
    )  # fmt: skip
    counts = np.rint((points - offset) / scale).astype(int).tolist()
    rows = [
        struct.pack("<iiiHBBbBH", *count, 0, 0, kind, 0, 0, 0)
        for count, kind in zip(counts, classes, strict=True)
    ]
    return head + b"".join(rows)


def test_a_file_written_by_hand_is_read(tmp_path):
    points = places(50)
    classes = np.tile([2, 5], 25)
    (tmp_path / "a.las").write_bytes(by_hand(points, classes))
    found, crs = read_clouds([tmp_path / "a.las"])
    np.testing.assert_allclose(found, points[::2], rtol=0, atol=1e-9)
    assert crs is None
    found, _ = read_clouds([tmp_path / "a.las"], classes=[2, 5])
    assert len(found) == 50


@pytest.mark.parametrize("name", ["Gelände.las", "Gelände.laz"])
def test_ground_that_is_not_withheld_is_taken(name, tmp_path, monkeypatch):
    points, number = places(), np.arange(3000)
    path = cloud(tmp_path / name, points, number % 3, withheld=number < 300)
    found, crs = read_clouds([path])
    wanted = points[(number % 3 == 2) & (number >= 300)]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)
    assert crs.to_epsg() == 2056
    monkeypatch.setattr("rockfall.io.vectors.point_clouds.CHUNK", 7)
    np.testing.assert_array_equal(read_clouds([path])[0], found)


def test_without_ground_the_classes_are_named(tmp_path):
    path = cloud(tmp_path / "a.laz", places(), np.arange(3000) % 2)
    message = (
        f"{path}: has no points of class 2 (classes: 0 (1,500 points), 1 (1,500 points)): "
        "choose with --classes"
    )
    with refused(message):
        read_clouds([path])
    assert len(read_clouds([path], classes=[0, 1])[0]) == 3000


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_a_file_that_is_cut_off_is_one_line(name, tmp_path):
    whole = cloud(tmp_path / name, places()).read_bytes()
    path = tmp_path / f"cut{name[1:]}"
    for size in [*range(0, len(whole), len(whole) // 60), len(whole) - 1]:
        path.write_bytes(whole[:size])
        with pytest.raises(RockfallError) as caught:
            read_clouds([path])
        assert str(caught.value).startswith(f"{path}: ") and caught.value.code == 2


def test_a_header_that_claims_more_than_there_is_is_one_line(tmp_path):
    path = tmp_path / "a.las"
    for at, kind, value in (
        (100, "<I", 2**32 - 1),  # number of records
        (107, "<I", 10**9),  # number of points
        (96, "<I", 2**31),  # offset of points
    ):
        bad = bytearray(by_hand(places(50), [2] * 50))
        struct.pack_into(kind, bad, at, value)
        path.write_bytes(bad)
        begin = time.perf_counter()
        with refused(f"{path}: is truncated: shorter than its header states"):
            read_clouds([path])
        assert time.perf_counter() - begin < 5


@pytest.mark.all
@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_changed_bytes_are_one_line_or_points(name, tmp_path):
    whole, random = cloud(tmp_path / name, places()).read_bytes(), np.random.default_rng(7)
    path, refusals = tmp_path / f"bad{name[1:]}", 0
    for _ in range(150):
        bad = bytearray(whole)
        for at in random.integers(0, 400, 4):
            bad[at] = random.integers(0, 256)
        path.write_bytes(bad)
        try:
            found, _ = read_clouds([path])
        except RockfallError as error:
            refusals += 1
            assert "\n" not in str(error) and error.code == 2
        else:
            assert np.isfinite(found).all() and len(found)
    assert refusals > 20


def test_files_of_several_systems_are_refused(tmp_path):
    one, other, none = (
        cloud(tmp_path / name, places(), crs=crs)
        for name, crs in (("a.laz", 2056), ("b.laz", 25832), ("c.laz", None))
    )
    with refused(f"{other}: has EPSG:25832, but {one} has EPSG:2056: all must have the same CRS"):
        read_clouds([one, other])
    with refused(f"{none}: has no CRS, but {one} has EPSG:2056: all must have the same CRS"):
        read_clouds([one, none])
    assert len(read_clouds([one, one])[0]) == 6000
    with refused(f"--crs: {one} has its own CRS, EPSG:2056"):
        dem_of_points(one, crs="EPSG:2056")
    dem, _ = dem_of_points(none, crs="EPSG:2056", cell=5.0)
    assert dem.grid.crs.to_epsg() == 2056


@pytest.mark.parametrize(
    ("crs", "message"), [("EPSG:2056+5773", None), ("EPSG:2263+6360", "are in"), (4326, "degrees")]
)
def test_metres_are_needed(crs, message, tmp_path):
    """Coordinates in degrees, or with heights in feet, are refused."""
    path = cloud(tmp_path / "a.laz", places(), crs=crs)
    if message is None:
        assert dem_of_points(path, cell=5.0)[0].grid.crs is not None
    else:
        with pytest.raises(RockfallError, match=message):
            dem_of_points(path, cell=5.0)


def test_thinned_points_are_means_of_squares(tmp_path, monkeypatch):
    points = places()
    path = cloud(tmp_path / "a.laz", points)
    found, _ = read_clouds([path], thin=7.0)
    squares = np.floor(points[:, :2] / 7.0)
    wanted = [
        points[(squares == square).all(axis=1)].mean(axis=0)
        for square in np.unique(squares, axis=0)
    ]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-7)
    monkeypatch.setattr("rockfall.io.vectors.point_clouds.CHUNK", 100)
    np.testing.assert_allclose(read_clouds([path], thin=7.0)[0], found, rtol=0, atol=1e-7)
    points[:, 2] = np.round(500 + 0.5 * (points[:, 0] - W) - 0.25 * (points[:, 1] - S), 6)
    (tmp_path / "plane.xyz").write_text("\n".join(" ".join(map(repr, p)) for p in points.tolist()))
    x, y, z = read_clouds([tmp_path / "plane.xyz"], thin=3.0)[0].T
    np.testing.assert_allclose(z, 500 + 0.5 * (x - W) - 0.25 * (y - S), rtol=0, atol=1e-5)


def test_too_many_points_are_refused_with_the_way_out(tmp_path, monkeypatch):
    path = cloud(tmp_path / "a.laz", places())
    monkeypatch.setattr("rockfall.io.vectors.point_clouds.MAX_POINTS", 1000)
    with refused("more than 1,000 points: average them in squares of M metres with --thin M"):
        read_clouds([path])
    assert len(read_clouds([path], thin=5.0)[0]) == 96
    with refused("--thin 0.01: leaves more than 1,000 points: use a larger value"):
        read_clouds([path], thin=0.01)
    with refused("--thin 1e-05: too small for these coordinates"):
        read_clouds([path], thin=1e-5)


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3\n4 5 6\n",
        "  1   2 3 \n4 5\t6",
        "1,2,3\r\n4,5,6\r\n",
        "1; 2; 3\n4; 5; 6\n",
        "1 2 3 17 255\n4 5 6 18 255\n",
        "//X Y Z Intensity\n1 2 3 9\n4 5 6 9\n",
        "# x y z\n1 2 3\n4 5 6\n",
        "id,z,Y,x\n7,3,2,1\n8,6,5,4\n",
        "\ufeff1 2 3\n4 5 6\n",
    ],
)
def test_text_of_every_layout(text, tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text(text, encoding="utf-8", newline="")
    np.testing.assert_array_equal(read_clouds([path])[0], [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("x y z\n", "has no points"),
        ("1 2\n3 4\n", "line 1: 2 columns: must have x, y and z"),
        ("x y height\n1 2 3\n", "line 1: must have exactly one column z, or contain only numbers"),
        ("x y z z\n1 2 3 4\n", "line 1: must have exactly one column z, or contain only numbers"),
        ("1 2 3\n4 5\n", "x = 4, y = 5, z = nan: not a position [m]"),
        ("1 2 3\n4 5 1e99\n", "x = 4, y = 5, z = 1e+99: not a position [m]"),
    ],
)
def test_wrong_texts_are_one_line(text, message, tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text(text)
    with refused(f"{path}: {message}"):
        read_clouds([path])


@pytest.mark.parametrize("text", ["1 2 3\n4 five 6\n", "1;2;3,5\n4;5;6,5\n", "\0\1\2 3 \xff\n"])
def test_what_is_no_number_is_one_line(text, tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text(text)
    with pytest.raises(RockfallError) as caught:
        read_clouds([path])
    assert str(caught.value).startswith(f"{path}: ")


def test_tiles_become_the_dem_of_their_points(tmp_path, capsys):
    points, out = places(), tmp_path / "dem.tif"
    left = points[:, 0] < W + 30
    tiles = [
        str(cloud(tmp_path / name, points[which]))
        for name, which in (("west.laz", left), ("east.las", ~left))
    ]
    rows = np.concatenate([points[left], points[~left]]).tolist()
    (tmp_path / "points.csv").write_text("x,y,z\n" + "".join(f"{x},{y},{z}\n" for x, y, z in rows))
    assert main(["dem", *tiles, "-o", str(out), "--cell", "2"]) == 0
    assert "3,000 points" in capsys.readouterr().out
    z, grid = read_dem(out)
    wanted, _ = dem_of_points(tmp_path / "points.csv", cell=2.0)
    np.testing.assert_allclose(z, wanted.z, rtol=0, atol=1e-4)
    assert grid.crs.to_epsg() == 2056 and grid.matches(wanted.grid)
    assert main(["dem", *tiles, str(tmp_path / "points.csv"), "-o", str(out), "--overwrite"]) == 2
    assert "several files: must all be .las, .laz or .xyz" in capsys.readouterr().err
    assert main(["dem", str(tmp_path / "points.csv"), "-o", str(out), "--thin", "1",
                 "--overwrite"]) == 2  # fmt: skip
    assert "--classes and --thin are only valid for .las, .laz and .xyz" in capsys.readouterr().err


def test_errors_of_a_large_cloud_are_those_of_some(tmp_path, monkeypatch, capsys):
    path = cloud(tmp_path / "a.laz", places())
    monkeypatch.setattr("rockfall.draft.dem.MAX_LEFT_OUT", 1000)
    assert main(["dem", str(path), "-o", str(tmp_path / "dem.tif")]) == 0
    assert "standard error, each point of 1,000 left out: " in capsys.readouterr().out
