# SPDX-License-Identifier: BSD-3-Clause
"""No command overwrites its inputs, or other files without --overwrite. Files that belong together
are written together or not at all."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
from matplotlib.figure import Figure

import rockfall
import scenes
from made import PLACE, UTM, leave_pictures_blank, make_raster, refused, write_ascii
from rockfall.case.files import input_files
from rockfall.cli import main
from rockfall.io.atomic import atomic_folder, atomic_write
from rockfall.plots.figures import Figure as Drawing
from scenes import grid
from slope_case import CASE, TABLE, slope, zones

LAB = """&lab ratios = 1.0, layers = 1, points = 2, impacts = 1 /
&packing width = 4.0, depth = 1.0 /
"""
UNCERTAIN = "&ensemble volume_factor = 1.2 /\n"
STOPS = "x,y\n600060,4999900\n600061,4999905\n"


@pytest.fixture(scope="module")
def ready(tmp_path_factory):
    """Folder with a case, its result, and the two parts of the result."""
    folder = tmp_path_factory.mktemp("ready")
    with pytest.MonkeyPatch.context() as here:
        here.chdir(folder)
        make_raster("dem.tif", slope(), nodata=-9999)
        make_raster("zones.tif", zones(), nodata=-9999)
        texts = {"zones.csv": TABLE, "sets.nml": scenes.CALM_SETS, "stops.csv": STOPS}
        texts |= {"case.nml": CASE + UNCERTAIN, "lab.nml": LAB}
        for name, text in texts.items():
            Path(name).write_text(text)
        assert main(["run", "case.nml", "-o", "r.nc", "--quiet"]) == 0
        for k in (1, 2):
            assert main(["run", "case.nml", "--quiet", "--shard", f"{k}/2"]) == 0
    return folder


def small():
    return Figure(figsize=(1, 1))


@pytest.fixture
def place(ready, tmp_path, monkeypatch):
    """Work in a copy of `ready`, with placeholders for slow figures."""
    shutil.copytree(ready, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    drawn = [Drawing(name, name, name, small) for name in ("passing", "profile", "stops")]
    monkeypatch.setattr("rockfall.products.figures_of", lambda *_, **_kept: drawn)
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_, **_kept: drawn)
    leave_pictures_blank(monkeypatch)
    return tmp_path


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


FEW = ("--runs", "8", "--boulders", "2")
PARTS, JOBS = ("case.part1of2", "case.part2of2"), ("slurm", "case.nml", "jobs")
COMMANDS = {  # arguments, a written file, and the inputs of the command
    "run": (["run", "case.nml", "--quiet"], "case.nc", "dem.tif"),
    "merge": (["merge", *PARTS, "-o", "m.nc"], "m.nc", "case.part2of2"),
    "ensemble": (["ensemble", "case.nml", *FEW, "--quiet"], "case-ensemble.nc", "dem.tif"),
    "its table": (
        ["ensemble", "case.nml", *FEW, "--quiet", "-o", "e.csv"], "e.csv", "zones.csv",
    ),
    "export, a map": (["export", "r.nc", "out"], "out/passages.tif", "dem.tif"),
    "compare": (["compare", "r.nc", "stops.csv", "-o", "c.csv"], "c.csv", "stops.csv"),
    "lines": (["lines", "r.nc", "-o", "t.csv"], "t.csv", "zones.csv"),
    "figures": (["figures", "r.nc", "out"], "out/stops.png", "dem.tif"),
    "report": (["report", "r.nc", "--observed", "stops.csv"], "r.html", "stops.csv"),
    "slurm": ([*JOBS, "--shards", "2"], "jobs/merge.sh", "case.nml"),
}  # fmt: skip
if find_spec("rockfall_lab"):
    pack = ["lab", "pack", "lab.nml", "--layers", "1", "-o", "l.pdf"]
    COMMANDS |= {
        "lab pack": (pack, "l.pdf", "lab.nml"),
        "lab impact": (["lab", "impact", "lab.nml", "--quiet"], "lab.nc", "lab.nml"),
    }


def make_folder(_, target):
    os.mkdir(target)


@pytest.mark.all
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_replaces_a_file_if_told_to_but_no_input(name, place, capsys):
    words, target, read = COMMANDS[name]
    Path(target).parent.mkdir(exist_ok=True)
    Path(target).write_text("of before")
    before = contents(place)
    capsys.readouterr()
    assert main(words) == 2
    out, err = capsys.readouterr()
    said = "already exists; not overwritten (--overwrite replaces it)\n"
    assert out == "" and err.endswith(said) and err.count("\n") == 1
    assert contents(place) == before
    words = [*words, "--overwrite"]
    assert main(words) == 0, capsys.readouterr().err
    assert Path(target).read_bytes() != b"of before"
    for message, put in (
        ("is an input", os.link),
        ("is an input", lambda file, target: os.symlink(Path(file).absolute(), target)),
        ("is a folder", make_folder),
        ("is not a regular file", lambda _, target: os.mkfifo(target)),
    ):
        if sys.platform == "win32" and put not in (os.link, make_folder):
            continue  # links need a privilege on Windows, and pipes are not files there
        Path(target).rmdir() if Path(target).is_dir() else Path(target).unlink()
        put(read, target)
        before = contents(place)
        capsys.readouterr()
        assert main(words) == 2
        out, err = capsys.readouterr()
        assert out == "" and f"{Path(target)}: {message}" in err and err.count("\n") == 1
        assert contents(place) == before


def test_a_case_that_is_called_like_its_dem_keeps_it(place, capsys):
    shutil.copy("dem.tif", "dem.nc")  # GDAL examines the contents
    Path("dem.nml").write_text(CASE.replace("dem.tif", "dem.nc"))
    before = contents(place)
    for words in ([], ["-o", "dem.nc"], ["-o", "../x/../dem.nc"], ["-o", f"{place}/dem.nc"]):
        (place.parent / "x").mkdir(exist_ok=True)
        words = [word.replace("../x/../", f"../x/../{place.name}/") for word in words]
        assert main(["run", "dem.nml", *words]) == 2
        assert capsys.readouterr().err.endswith("dem.nc: is an input; not overwritten\n")
    assert contents(place) == before
    with refused("dem.tif: is an input; not overwritten"):
        rockfall.write_result(rockfall.read_result("r.nc"), "dem.tif")


def test_every_file_behind_a_case_is_known(place, capsys):
    """Files of a case that must not be overwritten include companions: mask and notes of a GeoTIFF,
    and the other files of an ASCII grid and a shapefile."""
    pyogrio = pytest.importorskip("pyogrio")
    shapely = pytest.importorskip("shapely")
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False):
        with rasterio.open("dem.tif", "r+") as file:
            file.nodata = None
            file.write_mask(np.full(file.shape, 255, "u1"))
    Path("dem.tif.aux.xml").write_text("<PAMDataset><Metadata/></PAMDataset>")
    write_ascii(
        "zones.asc", zones(), grid(slope(), west=PLACE.c, south=PLACE.f - 5.0 * len(slope()))
    )
    Path("zones.prj").write_text(rasterio.CRS.from_string(UTM).to_wkt(version="WKT1_ESRI"))
    box = shapely.box(600040.0, 4999960.0, 600080.0, 4999990.0)
    pyogrio.raw.write(
        "sources.shp", shapely.to_wkb(np.array([box])), [np.array([1])], ["id"],
        geometry_type="Polygon", crs=UTM, driver="ESRI Shapefile",
    )  # fmt: skip
    shutil.copy("sets.nml", "harder.nml")
    text = CASE.replace("zones.tif", "zones.asc")
    text = text.replace("x = 600060.0, y = 4999980.0", "polygons = 'sources.shp'")
    Path("all.nml").write_text(text + "&ensemble sets = 'sets.nml', 'harder.nml' /\n")
    names = [
        "all.nml", "dem.tif", "dem.tif.msk", "dem.tif.aux.xml", "zones.asc",
        "zones.prj", "zones.csv", "sets.nml", "harder.nml", "sources.shp", "sources.shx",
        "sources.dbf", "sources.prj", "sources.cpg",
    ]  # fmt: skip
    files = [path for path in input_files(rockfall.read_case("all.nml")) if path.exists()]
    known = {path.name.lower() for path in files}  # Windows has SOURCES.SHP for sources.shp
    assert known == set(names)
    for name in names:
        os.link(name, "out.nc")
        before = Path(name).read_bytes()
        assert main(["run", "all.nml", "-o", "out.nc"]) == 2
        assert capsys.readouterr().err == "rockfall: out.nc: is an input; not overwritten\n"
        assert Path(name).read_bytes() == before
        Path("out.nc").unlink()
    assert main(["run", "all.nml", "-o", "out.nc", "--quiet"]) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="rights are not modes there")
def test_a_file_is_written_where_nobody_can_place_a_link(tmp_path):
    """A file is written in a folder with an unpredictable name, and gets the permissions of the
    umask."""
    (tmp_path / "victim").write_text("mine")
    for name in (f".out.{os.getpid()}.csv", f".out.csv.{os.getpid()}"):
        (tmp_path / name).symlink_to("victim")
    before = os.umask(0o027)
    try:
        places = []
        for _ in range(2):
            with atomic_write(tmp_path / "out.csv") as part:
                places.append(part.parent)
                assert part.parent.stat().st_mode & 0o777 == 0o700 and part.name == "out.csv"
                part.write_text("ours")
    finally:
        os.umask(before)
    assert places[0] != places[1] and (tmp_path / "victim").read_text() == "mine"
    assert (tmp_path / "out.csv").stat().st_mode & 0o777 == 0o640
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]


# ---- all or none


@pytest.mark.parametrize("free", [0, 2**30])
def test_a_full_disk_is_named_where_a_library_does_not(few_boulders, tmp_path, monkeypatch, free):
    """netCDF reports a full disk as missing permission or as an error in HDF5: the message has the
    cause."""

    def failed(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("rockfall.result.dataset._write_variable", failed)
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=free))
    result = rockfall.run(rockfall.read_case(few_boulders))
    reason = "[Errno 13] Permission denied" if free else "No space left on device"
    with pytest.raises(rockfall.RockfallError) as caught:
        rockfall.write_result(result, tmp_path / "result.nc")
    assert str(caught.value) == f"{tmp_path / 'result.nc'}: cannot be written: {reason}"
    assert not (tmp_path / "result.nc").exists()


NEW, OLD = "new\n", "old\n"


def failing(call, error, alone=False):
    """Replacement for `replace` that fails once, at a given call: counted for files written by
    themselves if `alone`, else for files of a folder."""
    done = []

    def replace(source, target):
        if source.parent.name.startswith(".rockfall-") is not alone:
            return os.replace(source, target)
        done.append(source)
        if len(done) == call:
            raise error
        os.replace(source, target)

    return replace


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("call", range(1, 6))
def test_files_of_a_folder_come_together_or_not_at_all(tmp_path, monkeypatch, call, error):
    """Renaming fails at any of its calls, for two files that are replaced and a third that is new:
    the folder keeps its old files, and the new files are in another folder."""
    folder = tmp_path / "folder"
    folder.mkdir()
    for name in ("a.csv", "b.csv", "other.txt"):
        (folder / name).write_text(OLD)
    before = contents(tmp_path)
    monkeypatch.setattr("rockfall.io.atomic.replace", failing(call, error))
    with pytest.raises((rockfall.RockfallError, KeyboardInterrupt)) as caught:
        with atomic_folder(folder, last="z.csv") as part:
            for name in ("a.csv", "b.csv", "z.csv"):
                (part / name).write_text(NEW)
    kept = tmp_path / "folder-2"
    if isinstance(error, OSError):
        told = "no renaming: No space left on device. The new files are in"
        assert str(caught.value) == f"{folder}: {told} {kept}"
        assert {path.name: path.read_text() for path in kept.iterdir()} == dict.fromkeys(
            ("a.csv", "b.csv", "z.csv"), NEW
        )
        shutil.rmtree(kept)
    assert contents(tmp_path) == before
    monkeypatch.undo()
    with atomic_folder(folder, last="z.csv") as part:
        for name in ("a.csv", "b.csv", "z.csv"):
            (part / name).write_text(NEW)
    texts = {path.name: path.read_text() for path in folder.iterdir()}
    assert texts == {"a.csv": NEW, "b.csv": NEW, "z.csv": NEW, "other.txt": OLD}


def test_folders_that_were_not_there_are_not_left(tmp_path, monkeypatch):
    monkeypatch.setattr("rockfall.io.atomic.replace", failing(2, OSError(5, "broken")))
    with pytest.raises(rockfall.RockfallError, match="broken") as caught:
        with atomic_folder(tmp_path / "some" / "where") as part:
            (part / "a").touch()
            (part / "b").touch()
    (kept,) = tmp_path.glob(".rockfall-*/new")  # no folder exists next to which they could be
    assert str(caught.value).endswith(f"broken. The new files are in {kept}")
    assert not (tmp_path / "some").exists()
    assert sorted(path.name for path in kept.iterdir()) == ["a", "b"]


KILLED = """import os, pathlib, signal, sys
from rockfall.io.atomic import atomic_folder
with atomic_folder(pathlib.Path("new")) as part:
    (part / "a.csv").touch()
    for old in sys.argv[1:]:
        (part.parent / "old" / old).touch()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="an open file keeps its name")
def test_temporary_folders_of_killed_processes_go(tmp_path):
    """The next write removes temporary folders, except those in use and those with replaced
    files."""
    for replaced in ("a.csv", ""):
        subprocess.run([sys.executable, "-c", KILLED, *filter(None, [replaced])], cwd=tmp_path)
    assert len([*tmp_path.iterdir()]) == 2
    with atomic_folder(tmp_path / "other") as part:
        (left,) = {*tmp_path.iterdir()} - {part.parent}
        assert (left / "old" / "a.csv").exists()
        with atomic_write(tmp_path / "b.csv") as file:
            file.touch()
        assert part.exists()
    assert {*tmp_path.iterdir()} == {left, tmp_path / "other", tmp_path / "b.csv"}


HELD = PermissionError(13, "Access is denied", "a.csv")


def test_what_replaces_an_open_file_is_kept_next_to_it(place, monkeypatch, capsys):
    """A file that another program has open cannot be replaced on Windows."""
    before = Path("r.nc").read_bytes()
    for kept in ("r-2.nc", "r-3.nc"):
        monkeypatch.setattr("rockfall.io.atomic.replace", failing(1, HELD, alone=True))
        assert main(["run", "case.nml", "-o", "r.nc", "--quiet", "--overwrite"]) == 2
        told = "cannot be replaced (is it open in another program?). The new file is"
        assert capsys.readouterr().err == f"rockfall: r.nc: {told} {kept}\n"
        assert rockfall.read_result(kept).equals(rockfall.read_result("r.nc"))
    assert Path("r.nc").read_bytes() == before and not list(place.glob(".*"))


def test_a_folder_with_an_open_file_keeps_its_files_and_leaves_the_new_ones(tmp_path, monkeypatch):
    (folder := tmp_path / "zones").mkdir()
    (folder / "a.csv").write_text(OLD)
    monkeypatch.setattr("rockfall.io.atomic.replace", failing(1, HELD))
    with pytest.raises(rockfall.RockfallError, match=r"^a.csv: .* open .*zones-2$"):
        with atomic_folder(folder) as part:
            (part / "a.csv").write_text(NEW)
    texts = {str(path.relative_to(tmp_path)): path.read_text() for path in contents(tmp_path)}
    assert texts == {str(Path("zones/a.csv")): OLD, str(Path("zones-2/a.csv")): NEW}


@pytest.mark.skipif(sys.platform != "win32", reason="other systems rename over an open file")
def test_a_file_that_is_open_is_not_lost(tmp_path):
    path = tmp_path / "lines.csv"
    path.write_text(OLD)
    with open(path), pytest.raises(rockfall.RockfallError, match=r"The new file is .*lines-2\.csv"):
        with atomic_write(path) as part:
            part.write_text(NEW)
    assert path.read_text() == OLD and path.with_name("lines-2.csv").read_text() == NEW


def test_a_result_has_a_name_that_netcdf_opens(place, monkeypatch, capsys):
    """On Windows, netCDF cannot open paths with letters outside its code page: they are refused."""
    assert main(["run", "case.nml", "-o", "Blöcke.nc", "--quiet"]) == 0
    if sys.platform != "win32":
        monkeypatch.setattr("rockfall.io.netcdf.NETCDF_NAMES", "cp1252")
    assert main(["run", "case.nml", "-o", "落石.nc", "--quiet"]) == 2
    told = "netCDF cannot open paths with letters outside the code page of this Windows: rename"
    assert capsys.readouterr().err.startswith(f"rockfall: 落石.nc: {told}")


WORDS = {
    "export": ["export", "r.nc", "out"],
    "figures": ["figures", "r.nc", "out"],
    "lines": ["lines", "r.nc", "-o", "t.csv"],
    "slurm": ["slurm", "case.nml", "out", "--shards", "2"],
    "prepare": ["prepare", "case.nml", "out"],
}


@pytest.mark.family(3)
@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.all) if one in ("export", "figures") else one
     for one in WORDS],
)  # fmt: skip
def test_a_command_that_fails_half_way_changes_nothing(name, place, monkeypatch, capsys):
    words = [*WORDS[name], "--overwrite"]
    for earlier in (False, True):  # with nothing there, then with files of another run
        before = contents(place)
        broken = failing(4 if earlier else 2, OSError(28, "No space left on device"))
        with monkeypatch.context() as once:  # figures are blank again afterwards
            once.setattr("rockfall.io.atomic.replace", broken)
            capsys.readouterr()
            assert main(words) == 2
        said = capsys.readouterr().err
        assert "no renaming: No space left on device. The new files are in" in said
        kept = Path(said.split()[-1])
        assert any(kept.iterdir())
        shutil.rmtree(kept.parent if kept.name == "new" else kept)
        assert contents(place) == before and not list(place.glob(".*"))
        assert main(words) == 0
