# SPDX-License-Identifier: BSD-3-Clause
"""`--resume` of finished variants or of a finished hazard: exit 0, one line, no byte changes."""

import contextlib
from functools import partial
from pathlib import Path

import netCDF4
import pytest

import slope_case
from made import make_layer
from programs import Killed, everything, killed_after
from rockfall.cli import main
from rockfall.simulation import simulate

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pytest.importorskip("pyogrio", reason="the vector extra is not installed")

FINISHED = "rockfall: out: already contains the finished run of this case: nothing was changed\n"
EXISTS = "already exists; not overwritten (--overwrite replaces it)\n"
HOUSE = shapely.box(600040, 4999900, 600070, 4999920)
ROAD = shapely.LineString([(600000, 4999905), (600120, 4999930)])
VARIANTS = """&barrier name = 'net', x = 600000., 600120., y = 2*4999950., height = 3.0, class = 4 /
&variant name = 'net' /
&variant name = 'bare', without = 'barrier' /
"""
SCENARIOS = """&scenario name = 'small', frequency = 3.0, volume_mean = 0.1 /
&scenario name = 'large', return_period = 40.0, volume_mean = 2.0 /
"""
CURVES = "name,energy,vulnerability,source\nown,0,0,A.\nown,{},0.5,A.\nown,900,1,A.\n"
COMMANDS = {
    "variants": ["variants", "case.nml", "-o", "out", "--quiet"],
    "variants with a page": ["variants", "case.nml", "-o", "out", "--quiet", "--report"],
    "hazard": ["hazard", "case.nml", "-o", "out", "--quiet"],
    "hazard of objects": ["hazard", "case.nml", "-o", "out", "--quiet", "--objects",
                          "houses.gpkg", "--vulnerability", "curves.csv", "--segments",
                          "road.gpkg", "--segment-length", "40"],
}  # fmt: skip
FIRST = {"variants": "net.nc", "variants with a page": "net.nc"}


def layers(persons=2.0, width=5.0, house=HOUSE, half=100):
    about = {"value": [4e5], "curve": ["own"], "persons": [persons], "kind": ["building"]}
    make_layer("houses.gpkg", [house], **about)
    make_layer("road.gpkg", [ROAD], width=[width])
    Path("curves.csv").write_text(CURVES.format(half))


def finish(what, folder):
    """Run a command to the end in a folder, after writing its inputs."""
    groups = SCENARIOS if "hazard" in what else VARIANTS
    with contextlib.chdir(folder):
        slope_case.write_slope()
        Path("case.nml").write_text(Path("case.nml").read_text() + groups)
        layers()
        assert main(COMMANDS[what]) == 0


@pytest.fixture(autouse=True)
def finished(gallery, tmp_path, monkeypatch, blank_figures, request):
    what = request.node.callspec.params["what"]
    monkeypatch.chdir(gallery.copy(what, partial(finish, what), tmp_path))


@pytest.mark.all
@pytest.mark.parametrize("what", COMMANDS)
def test_a_finished_folder_is_left_as_it_is(what, capfd):
    before = everything(Path())
    for more in [], ["--overwrite"], ["--threads", "2"], ["--checkpoint", "0"]:
        capfd.readouterr()
        assert main([*COMMANDS[what], "--resume", *more]) == 0
        assert capfd.readouterr() == ("", FINISHED)
        assert everything(Path()) == before


def rewritten(old, new):
    path = Path("case.nml")
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def edited(**attrs):
    def change():
        for name in "hazard.nc", "bare.nc":
            if (path := Path("out") / name).exists():
                with netCDF4.Dataset(path, "r+") as file:
                    file.setncatts(attrs)

    return change


def cut():
    for name in "hazard.nc", "bare.nc":
        if (path := Path("out") / name).exists():
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 20])


OF_ALL = {
    "drop height": lambda: rewritten("drop_height = 2.0", "drop_height = 2.5"),
    "seed": lambda: rewritten("seed = 7", "seed = 8"),
    "version": edited(version="9"),
    "input": edited(input_checksums="{}"),
    "damaged": cut,
}
CHANGES = {
    **{(what, name): change for what in COMMANDS for name, change in OF_ALL.items()},
    ("variants", "a net"): lambda: rewritten("height = 3.0", "height = 3.5"),
    ("variants", "a file less"): lambda: Path("out/differences.csv").unlink(),
    ("variants with a page", "no page"): lambda: Path("out/variants.html").unlink(),
    ("hazard", "frequency"): lambda: rewritten("frequency = 3.0", "frequency = 2.0"),
    ("hazard", "return period"): lambda: rewritten("return_period = 40.0", "return_period = 41.0"),
    ("hazard of objects", "persons"): lambda: layers(persons=3.0),
    ("hazard of objects", "a curve"): lambda: layers(half=120),
    ("hazard of objects", "a wider road"): lambda: layers(width=6.0),
    ("hazard of objects", "another house"): lambda: layers(house=HOUSE.buffer(1.0)),
}


@pytest.mark.all
@pytest.mark.parametrize("what, name", CHANGES)
def test_what_is_not_the_same_is_not_overwritten_unasked(what, name, capfd):
    words = [*COMMANDS[what], "--resume"]
    CHANGES[what, name]()
    before = everything(Path())
    capfd.readouterr()
    assert main(words) == 2
    path = Path("out") / FIRST.get(what, "hazard.nc")
    assert capfd.readouterr().err == f"rockfall: {path}: {EXISTS}"
    assert everything(Path()) == before
    if name == "seed":  # once for each command
        assert main([*words, "--overwrite"]) == 0
        capfd.readouterr()
        assert main(words) == 0 and capfd.readouterr().err == FINISHED


@pytest.mark.parametrize("what", ["variants", pytest.param("hazard", marks=pytest.mark.all)])
def test_a_study_that_was_stopped_goes_on(what, monkeypatch, capfd):
    """With --resume --overwrite a study continues from its checkpoint, next to an older folder;
    with --resume alone it is refused."""
    before = everything(Path("out"))
    with monkeypatch.context() as patch:
        patch.setattr(simulate, "FIRST_CHUNK", 5)
        killed_after(patch, 1)
        with pytest.raises(Killed):
            main([*COMMANDS[what], "--overwrite", "--checkpoint", "1e-9"])
    assert list(Path().glob("out.*.checkpoint")) and everything(Path("out")) == before
    capfd.readouterr()
    assert main([*COMMANDS[what], "--resume"]) == 2
    assert "not overwritten" in capfd.readouterr().err
    assert main([*COMMANDS[what], "--resume", "--overwrite"]) == 0
    assert not list(Path().glob("out.*.checkpoint"))
