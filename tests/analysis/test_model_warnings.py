# SPDX-License-Identifier: BSD-3-Clause
"""Model warnings of a run appear once in each study: commands print them, functions give Python
warnings and an attribute."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import rockfall
from made import make_raster
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.case import case_of
from rockfall.cli import main
from rockfall.studies import convergence
from rockfall.studies.back import study

CASE = """&case boulders = 60, seed = 7, threads = 1 /
&terrain dem = 'dem.tif' /
&surface ground = 'soil_4', uniform_mean_radius = 0.1 /
&boulder volume = 'fixed', volume_mean = 0.8 /
&release x = 600060.0, y = 4999980.0, drop_height = 2.0 /
&line name = 'L', x = 600000.0, 600120.0, y = 4999960.0, 4999960.0 /
&ensemble runs = 8, volume_factor = 1.2, source_shift = 1.0 /
"""
CLASSICAL = "followed classical grounds (soil_4 (rockyfor3d) 100 %)"
SPEEDS = "line,quantity,unit,value\n" + "".join(f"L,speed,m/s,{v}\n" for v in range(4, 12))


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study, "ROUND", 16)
    monkeypatch.setattr(convergence, "MIN_REFERENCE", 1)  # few boulders suffice for warnings
    z = (1100 - 0.9 * np.arange(30)[:, None] * 5.0 + np.zeros(24)).astype("f4")
    make_raster("dem.tif", z, nodata=-9999)
    Path("case.nml").write_text(CASE)
    Path("seen.csv").write_text(SPEEDS)


def warned(function, *arguments, **more):
    """Return value of a function, and its warnings, which must point to the calling file."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = function(*arguments, **more)
    said = [one for one in caught if issubclass(one.category, UserWarning)]
    assert {one.filename for one in said} == {__file__}
    return found, [str(one.message) for one in said]


def test_functions_give_each_warning_once_and_keep_it():
    case = rockfall.read_case("case.nml")
    result, said = warned(rockfall.run, case)
    own = [*model_warnings(result, case_of(result))]
    assert said == own == result.attrs["model_warnings"].splitlines()
    rockfall.write_result(result, "result.nc")
    assert "model_warnings" not in rockfall.read_result("result.nc").attrs
    assert sum(CLASSICAL in text for text in own) == 1
    parts = [rockfall.run(case, shard=(k, 2)) for k in (1, 2)]
    assert not any("model_warnings" in part.attrs for part in parts)
    merged, said = warned(rockfall.merge, parts)
    assert said == own == merged.attrs["model_warnings"].splitlines()
    many, said = warned(rockfall.run_until, case, "speed.mean@L<50%")
    assert said == many.attrs["model_warnings"].splitlines() and CLASSICAL in "".join(said)
    drawn, said = warned(rockfall.run_ensemble, case)
    assert said == drawn.attrs["model_warnings"].splitlines() and CLASSICAL in "".join(said)


def test_studies_of_several_results_give_a_warning_once():
    net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    case = rockfall.read_case("case.nml").replace(
        barrier=[net | {"height": 3.0, "class": 4}],
        variant=[{"name": "bare", "without": ["barrier"]}, {"name": "with net"}],
    )
    results, said = warned(rockfall.run_variants, case)
    assert sum(CLASSICAL in text for text in said) == 1
    for result in results.values():
        assert CLASSICAL in result.attrs["model_warnings"]
    two = [{"name": name, "frequency": 0.1} for name in ("often", "again")]
    _, said = warned(rockfall.hazard, rockfall.read_case("case.nml").replace(scenario=two))
    assert sum(CLASSICAL in text for text in said) == 1


COMMANDS = {
    "models": ["case.nml", "--ground", "road", "-o", "out", "--quiet"],
    "validate": ["case.nml", "seen.csv", "--table", "meadow", "--seeds", "2", "--quiet"],
    "back": ["case.nml", "seen.csv", "--members", "32", "--effective", "2", "--quiet"],
    "convergence": ["case.nml", "--boulders", "20", "--reference", "320", "-o", "out"],
}


@pytest.mark.all
@pytest.mark.parametrize("command", COMMANDS)
def test_commands_print_each_warning_once(capfd, command):
    assert main([command, *COMMANDS[command]]) == 0
    err = capfd.readouterr().err
    said = [line for line in err.splitlines() if line.startswith("rockfall: warning: ")]
    assert sum(CLASSICAL in line for line in said) == 1
    assert len(said) == len({*said})
    if command == "validate":
        of_table = [line for line in said if "followed impact tables" in line]
        assert len(of_table) == 1 and of_table[0].startswith("rockfall: warning: table meadow: ")
