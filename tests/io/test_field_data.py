# SPDX-License-Identifier: BSD-3-Clause
"""Data of field experiments: files with the published checksums become cases, other files are
refused in one line. No network is used."""

import hashlib
import importlib.util
import re
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import numpy as np
import pandas as pd
import pytest
from affine import Affine

import rockfall
from benchmarks.field_data import ARCHIVES, FOLDER, RemoteFile, fetch
from made import make_layer, make_raster
from rockfall.analysis.observed.observations import read_observed
from rockfall.errors import RockfallError

ROOT = Path(__file__).parents[2]
TSCHAMUT, MEL = "tschamut2014", "mel_de_la_niva_2015"
STARTS = """\
trajectory_id,x_m,y_m,vx_mps,vy_mps,vz_mps,block_id,mass_kg,radius_m
v2,30,60,0.5,1.5,0.25,2,79,0.198
v1,31,61,0.5,1.5,0.25,1,69,0.177
v4,32,62,0.5,1.5,0.25,4,40,0.160
v3,33,63,0.5,1.5,0.25,1,69,0.177
"""
RESTS = "trajectory_id,x_m,y_m\nv1,34,31\nv2,35,30\nv3,36,28\nv4,30,25\n"


def terrain_text():
    """ESRI ASCII grid of 20 by 20 cells of 5 m that falls to the south."""
    rows = [" ".join([f"{100 - 3.0 * row:.1f}"] * 20) for row in range(20)]
    head = ["ncols 20", "nrows 20", "xllcorner 0", "yllcorner 0", "cellsize 5"]
    return "\n".join([*head, "NODATA_value -9999", *rows]) + "\n"


@pytest.fixture
def published(tmp_path, monkeypatch):
    """Function that replaces the files of an archive by files in a folder, with their checksums;
    returns the folder."""
    monkeypatch.delenv(FOLDER, raising=False)
    folder = tmp_path / "published"
    folder.mkdir()

    def publish(name, **contents):
        files = []
        for one in ARCHIVES[name].files:
            path = folder / one.name
            if one.name in contents:
                path.write_bytes(contents[one.name])
            algorithm = one.checksum.partition(":")[0]
            digest = hashlib.new(algorithm, path.read_bytes()).hexdigest()
            files.append(RemoteFile(one.name, path.as_uri(), f"{algorithm}:{digest}"))
        monkeypatch.setitem(ARCHIVES, name, replace(ARCHIVES[name], files=tuple(files)))
        return folder

    return publish


@pytest.fixture
def tschamut(published):
    contents = {"release_points.csv": STARTS, "observed_deposition.csv": RESTS}
    contents["terrain.asc"] = terrain_text()
    return published(TSCHAMUT, **{name: text.encode() for name, text in contents.items()})


def script(case):
    path = ROOT / "cases" / case / "make_case.py"
    spec = importlib.util.spec_from_file_location(f"make_{case}".replace("-", "_"), path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def command(module, monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["make_case.py", *map(str, words)])
    return module.main()


# ---- files


@pytest.mark.parametrize("name", ARCHIVES)
def test_every_archive_names_its_source(name):
    one = ARCHIVES[name]
    assert one.title and one.licence and one.citation and one.origin
    assert re.fullmatch(r"10\.\d{4,5}/\S+", one.doi)
    assert len(set(one.names)) == len(one.files) > 0
    digits = {"sha256": 64, "md5": 32}
    for file in one.files:
        algorithm, _, digest = file.checksum.partition(":")
        assert re.fullmatch(f"[0-9a-f]{{{digits[algorithm]}}}", digest)
        assert file.url.startswith(("https://", "doi:"))


@pytest.mark.parametrize("below", ["", TSCHAMUT])
def test_a_folder_stands_in_for_the_download(tschamut, tmp_path, monkeypatch, below):
    folder = tmp_path / "mine"
    (folder / below).parent.mkdir(parents=True, exist_ok=True)
    tschamut.rename(folder / below)
    monkeypatch.setitem(sys.modules, "pooch", None)
    found = fetch(TSCHAMUT, folder)
    assert found == {name: folder / below / name for name in ARCHIVES[TSCHAMUT].names}
    monkeypatch.setenv(FOLDER, str(folder))
    assert fetch(TSCHAMUT) == found


def test_what_is_not_as_published_is_refused(tschamut, tmp_path):
    with pytest.raises(RockfallError, match="no archive 'moon', known: .*tschamut2014"):
        fetch("moon")
    with pytest.raises(RockfallError, match="none: no such folder of field data"):
        fetch(TSCHAMUT, tmp_path / "none")
    (tschamut / "terrain.asc").write_text(terrain_text() + "\n")
    with pytest.raises(RockfallError, match=r"terrain.asc: sha256 \w+ differs from .*"):
        fetch(TSCHAMUT, tschamut)
    (tschamut / "terrain.asc").unlink()
    with pytest.raises(RockfallError, match="has no terrain.asc, nor tschamut2014/terrain.asc"):
        fetch(TSCHAMUT, tschamut)


def test_without_pooch_one_line_says_which_extra(tschamut, monkeypatch):
    monkeypatch.setitem(sys.modules, "pooch", None)
    with pytest.raises(RockfallError, match=r"needs the field extra: pip install 'rockfall\[field"):
        fetch(TSCHAMUT)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Give pooch a cache of its own, and a downloader that copies files; return the list of
    requested addresses."""
    pooch = pytest.importorskip("pooch", reason="the field extra is not installed")
    monkeypatch.setattr(pooch, "os_cache", lambda name: tmp_path / "cache" / name)
    asked = []

    def copier(url, **_):
        def copy(url, output, _pooch):
            asked.append(url)
            Path(output).write_bytes(Path(url2pathname(urlsplit(url).path)).read_bytes())

        return copy

    monkeypatch.setattr("pooch.core.choose_downloader", copier)
    return asked


def test_files_are_downloaded_once_and_checked(tschamut, cache, tmp_path):
    found = fetch(TSCHAMUT)
    for name, path in found.items():
        assert path == tmp_path / "cache" / "rockfall" / TSCHAMUT / name
        assert path.read_bytes() == (tschamut / name).read_bytes()
    assert len(cache) == 3
    assert fetch(TSCHAMUT) == found and len(cache) == 3


def test_a_download_of_something_else_is_refused(tschamut, cache):
    (tschamut / "terrain.asc").write_text("<html>not found</html>")
    with pytest.raises(RockfallError, match=r"Tschamut 2014 \(doi:10.16904/envidat.34\): .*hash"):
        fetch(TSCHAMUT)


def test_no_network_is_one_line_that_says_what_to_do(tschamut, cache):
    (tschamut / "terrain.asc").unlink()
    with pytest.raises(RockfallError, match="cannot be downloaded: .*; or give a folder with"):
        fetch(TSCHAMUT)


# ---- Tschamut


def test_the_case_of_tschamut_is_made_and_runs(tschamut, tmp_path, monkeypatch, capsys):
    module, out = script("tschamut"), tmp_path / "case"
    assert command(module, monkeypatch, "--data", tschamut, "--half", "all", "-o", out) == 0
    releases = pd.read_csv(out / "releases.csv")
    assert releases["name"].tolist() == ["v1", "v2", "v3", "v4"]
    mass = releases["volume"] * releases["density"]
    assert mass.tolist() == pytest.approx([69, 79, 69, 40], rel=1e-6)
    case = rockfall.read_case(ROOT / "cases/tschamut/case.nml")
    parts = []
    for block in module.BLOCKS:
        part = case.replace(
            case={"boulders": 3}, terrain={"dem": str(out / "dem.asc")},
            release={"points": str(out / f"releases-{block}.csv")},
        )  # fmt: skip
        result = rockfall.run(part)
        assert {*result["block_shape"].values} == {1 + [*module.BLOCKS].index(block)}
        seen = read_observed(out / f"observed-{block}.csv")
        rows = pd.read_csv(out / f"observed-{block}.csv")
        assert result.sizes["boulder"] == 3 * len(rows) and len(seen.stops) == len(rows)
        assert set(result["start_x"].values.tolist()) == set(rows["start_x"])
        parts.append(len(rows))
    assert parts == [2, 1, 1]


def test_halves_of_tschamut_share_no_run(tschamut, tmp_path, monkeypatch):
    module = script("tschamut")
    runs = []
    for half in ("calibration", "held-out"):
        assert command(module, monkeypatch, "--data", tschamut, "--half", half, "-o", tmp_path) == 0
        runs.append(pd.read_csv(tmp_path / "observed.csv")["run"].tolist())
    assert runs == [["v1", "v3"], ["v2", "v4"]]


def test_a_case_that_cannot_be_made_leaves_nothing(tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    for case in ("tschamut", "mel-de-la-niva"):
        assert command(script(case), monkeypatch, "--data", tmp_path / "no", "-o", out) == 2
        error = capsys.readouterr().err
        assert error.startswith("make_case.py: ") and error.count("\n") == 1
    assert not out.exists()


# ---- Mel de la Niva, only stand-ins


@pytest.fixture
def mel(published, tmp_path):
    """Files like those of the published archive, as far as these are known."""
    laspy = pytest.importorskip("laspy", reason="the field extra is not installed")
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    made = tmp_path / "made"
    made.mkdir()
    for number, west in ((1, 600.0), (2, 640.0)):
        las = laspy.create(point_format=0, file_version="1.2")
        las.header.scales, las.header.offsets = [0.01] * 3, [600000.0, 110000.0, 0.0]
        y = np.linspace(900, 500, 9)
        las.x, las.y, las.z = 600000 + west + 0 * y, 110000 + y, 2000 + 0.7 * y
        las.write(made / f"traj_bl{number}.las")
    places = 600000 + np.array([600.0, 645, 620]), 110000 + np.array([490.0, 480, 700])
    about = {"year": [2015, 2015, 1990], "size": ["[3; 2; 1]", "[4; 4; 4]", "unknown"]}
    make_layer(made / "deposited_bl.shp", shapely.points(*places), "EPSG:21781", **about)
    down = np.arange(1200)[:, None] * 0.5
    place = Affine(0.5, 0, 600500, 0, -0.5, 111000)
    raster = {"transform": place, "nodata": -9999.0, "crs": "EPSG:21781"}
    z = (2000 + 0.7 * (1000 - down) + np.zeros((1, 500))).astype("f4")
    make_raster(made / "dsm_lv1903_50cm.tif", z, **raster)

    def archive(name, *patterns):
        with zipfile.ZipFile(made / name, "w") as opened:
            for pattern in patterns:
                for path in sorted(made.glob(pattern)):
                    opened.write(path, f"{Path(name).stem}/{path.name}")
        return (made / name).read_bytes()

    names = ARCHIVES[MEL].names
    patterns = ("traj*.las",), ("deposited_bl.*",), ("dsm*.tif",)
    return published(MEL, **{n: archive(n, *p) for n, p in zip(names, patterns, strict=True)})


def test_the_case_of_the_mel_de_la_niva_is_made_of_a_stand_in(mel, tmp_path, monkeypatch):
    assert not ARCHIVES[MEL].tried
    out = tmp_path / "case"
    module = script("mel-de-la-niva")
    assert command(module, monkeypatch, "--data", mel, "--cell", "5", "-o", out) == 0
    releases = pd.read_csv(out / "releases.csv").set_index("name")
    assert releases.loc["traj_bl1", ["x", "y"]].tolist() == pytest.approx([600600, 110900])
    volumes = [np.pi / 6 * 6, np.pi / 6 * 64]
    assert releases["volume"].tolist() == pytest.approx(volumes, rel=1e-5)
    observed = pd.read_csv(out / "observed.csv")
    assert observed["start_x"].tolist() == pytest.approx([600600, 600640])
    case = rockfall.read_case(ROOT / "cases/mel-de-la-niva/case.nml").replace(
        case={"boulders": 2}, terrain={"dem": str(out / "dem.tif")},
        release={"points": str(out / "releases.csv")},
    )  # fmt: skip
    result = rockfall.run(case)
    assert result.sizes["boulder"] == 4
    assert "LV03" in result["crs"].attrs["crs_wkt"]


def test_a_file_that_is_not_there_is_named(mel, tmp_path, monkeypatch, capsys, published):
    names = ARCHIVES[MEL].names
    empty = tmp_path / "empty.zip"
    with zipfile.ZipFile(empty, "w"):
        pass
    published(MEL, **{names[0]: empty.read_bytes()})
    assert command(script("mel-de-la-niva"), monkeypatch, "--data", mel, "-o", tmp_path / "x") == 2
    assert f"{names[0]}: expected one traj_bl1.las in it, found 0" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
