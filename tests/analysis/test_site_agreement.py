# SPDX-License-Identifier: BSD-3-Clause
"""`&observed`: a run says whether it agrees with its site."""

from pathlib import Path

import numpy as np
import pytest

import rockfall
from rockfall.analysis.observed.compare import compare, disagreement
from rockfall.analysis.validity.site import angle_remarks
from rockfall.cli import main


@pytest.fixture
def seen(place):
    """A case with its result."""
    case = rockfall.read_case("case.nml").replace(case={"boulders": 1000})
    return case, rockfall.run(case)


def angles_of(result):
    fall = result["start_z"] - result["stop_z"]
    return np.degrees(np.arctan2(fall.values, result["plan_distance"].values))


def remark_on(result, case, observed):
    return list(angle_remarks(result, case.replace(observed={"energy_line_angle": observed})))


def test_the_angle_of_one_percent_is_set_beside_the_lowest_observed(seen):
    case, result = seen
    angle = float(np.quantile(angles_of(result), 0.01))
    for observed, key, is_warning in (
        (angle + 6, "model.angle_flatter", True),
        (angle, "model.angle_as_observed", False),
        (angle - 6, "model.angle_steeper", True),
    ):
        (remark,) = remark_on(result, case, observed)
        assert (remark.text.key, remark.is_warning) == (key, is_warning)
        assert f"{angle:.1f}°" in remark.text
    assert not list(angle_remarks(result, case))
    few = result.isel(boulder=slice(0, 999))
    assert not remark_on(few, case, angle)


def test_a_run_agrees_with_its_own_boulders_and_not_with_others(seen):
    _, result = seen
    distances = result["plan_distance"].values
    for factor, key in ((1.0, "compare.agrees"), (1.5, "compare.disagrees")):
        rows = "\n".join(f"{factor * value:.3f}" for value in distances[::7])
        Path("seen.csv").write_text(f"distance\n{rows}\n")
        text = disagreement(compare(result, "seen.csv"))
        assert text.key == key and text.values["tested"] > 1


def test_commands_take_the_files_of_the_case(seen, capsys):
    _, result = seen
    rows = "\n".join(f"{2 * value:.3f}" for value in result["plan_distance"].values[:200])
    Path("seen.csv").write_text(f"distance\n{rows}\n")
    text = Path("case.nml").read_text() + "\n&observed files = 'seen.csv' /\n"
    Path("seen.nml").write_text(text)
    assert main(["run", "seen.nml", "-o", "out.nc"]) == 0
    assert "differ from &observed" in capsys.readouterr().out
    assert main(["compare", "out.nc"]) == 0
    named = capsys.readouterr().out
    assert main(["compare", "out.nc", "seen.csv"]) == 0
    assert capsys.readouterr().out == named
    Path("seen.csv").unlink()
    assert main(["compare", "out.nc"]) == 2
    assert main(["run", "seen.nml", "-o", "other.nc"]) == 2
    assert "seen.nml: &observed files = 'seen.csv': no such file" in capsys.readouterr().err
    assert not Path("other.nc").exists()
    assert main(["back", "case.nml"]) == 2
    assert "or those of &observed in the case" in capsys.readouterr().err
