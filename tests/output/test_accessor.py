# SPDX-License-Identifier: BSD-3-Clause
"""Results have functions of the package as methods, whether computed or read from a file."""

import pytest

import rockfall
import scenes
from rockfall.accessor import OF_RESULTS

Z = scenes.rough()
PLACE = {"dem": Z, "transform": scenes.grid(Z)}
LINE = {"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    release = {"x": 120.0, "y": 380.0, "drop_height": 5.0}
    groups = {"release": release, "case": {"boulders": 50}}
    made = scenes.make_case(tmp_path_factory.mktemp("case"), *scenes.sets(2.0), **groups)
    return made.replace(line=[LINE], scenario=[{"name": "one", "frequency": 0.5}])


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_methods_are_the_functions(case, tmp_path):
    result = rockfall.run(case, **PLACE)
    result.rockfall.write_result(tmp_path / "a.nc")
    for one in (result, rockfall.read_result(tmp_path / "a.nc")):
        table = one.rockfall.line_statistics()
        assert table.equals(rockfall.line_statistics(result))
    hazard = rockfall.hazard(case, **PLACE)
    assert hazard.rockfall.exceedance("road").equals(rockfall.exceedance(hazard, "road"))
    period = hazard.rockfall.return_period("road", energy=30e3)
    assert period == rockfall.return_period(hazard, "road", energy=30e3)


def test_only_functions_of_results_are_methods(case):
    result = rockfall.run(case.replace(scenario=[]), **PLACE)
    assert {*OF_RESULTS} <= {*rockfall.__all__} and dir(result.rockfall) == [*OF_RESULTS]
    with pytest.raises(AttributeError, match="no function 'read_case' for results"):
        result.rockfall.read_case("case.nml")
