# SPDX-License-Identifier: BSD-3-Clause
"""Frequencies of variants are those of their hazards, and changes without effect change nothing."""

import numpy as np
import pytest

import rockfall
import scenes
from rockfall.analysis.hazard.variables import PERIODS
from rockfall.case.variants import variants
from rockfall.studies.yearly_variants import frequency_file, yearly_variants

Z = scenes.rough()
PLACE = {"dem": Z, "transform": scenes.grid(Z)}
LINES = [{"name": f"y{y}", "x": [0.0, 300.0], "y": [float(y)] * 2} for y in (300, 200)]
NET = {"name": "net", "x": [0.0, 300.0], "y": [250.0, 250.0], "height": 2.0, "capacity": 200.0}
SCENARIOS = [
    {"name": "often", "frequency": 8.0},
    {"name": "large", "frequency": 0.5, "volume_mean": 6.0},
]


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    groups = {
        "release": {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0},
        "case": {"boulders": 200},
    }
    made = scenes.make_case(tmp_path_factory.mktemp("case"), *scenes.sets(2.0), **groups)
    return made.replace(
        hazard={"thresholds": [40.0, 300.0], "object_width": 12.0, "frequency_factor": [0.8, 1.5]},
        line=LINES,
        barrier=[NET],
        scenario=SCENARIOS,
        variant=[
            {"name": "bare", "without": ["barrier"]},
            {"name": "net"},
        ],
    )


@pytest.fixture(scope="module")
def table(case):
    return by_row(yearly_variants(case, **PLACE).table)


def by_row(table):
    return table.set_index(["line", "variant", "quantity", "statistic"]).sort_index()


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", ["bare", "net"])
def test_frequencies_and_levels_are_those_of_the_hazard(case, table, name):
    found = rockfall.hazard(variants(case)[name], **PLACE)
    for k, line in enumerate(["y300", "y200"]):
        row = table.loc[line, name, "frequency", "all"]
        for end in ("", "_low", "_high"):
            assert row[f"value{end}"] == pytest.approx(
                float(found[f"line_frequency{end}"][k]), rel=1e-9
            )
        counts = found["line_energy_counts"].sel(exceeded_energy=300e3).values[:, k]
        weights = found["frequency"].values / found["boulders"].values
        above = table.loc[line, name, "frequency", "above_300"]
        assert above["value"] == pytest.approx(weights @ counts, rel=1e-9)
        for period, level in zip(PERIODS, found["line_energy_by_period"].values[k], strict=True):
            assert table.loc[line, name, "energy_by_period", f"{period:g}"]["value"] == level


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_boulders_that_pass_a_barrier_are_those_that_its_hazard_has_behind_it(case, table):
    found = rockfall.hazard(variants(case)["net"], **PLACE)
    k = found["line"].values.tolist().index("net")
    weights = found["frequency"].values / found["boulders"].values
    passing = weights @ found["line_behind"].values[:, k]
    rows = table.loc["net", "net"]
    assert rows.loc["frequency_behind", "all"]["value"] == pytest.approx(passing, rel=1e-9)
    arriving = float(found["line_frequency"][k])
    assert rows.loc["frequency", "all"]["value"] == pytest.approx(arriving, rel=1e-9)
    assert 0 < passing < arriving
    level = float(found["line_energy_by_period"][k].sel(event_period=100.0))
    assert rows.loc["energy_by_period", "100"]["value"] == level


def test_what_changes_nothing_differs_by_nothing(case):
    """A net below both lines changes no frequency."""
    names = [{"name": "bare", "without": ["barrier"]}, {"name": "far"}]
    far = case.replace(barrier=[NET | {"y": [20.0, 20.0]}], variant=names)
    table = by_row(yearly_variants(far, **PLACE).table).loc[["y200", "y300"]]
    same, bare = (table.xs(name, level="variant") for name in ("far", "bare"))
    changes = same["difference"].dropna()
    assert len(changes) == 2 * 3 and not changes.any()
    assert (same["value"] == bare["value"]).all()


def test_a_net_takes_from_what_comes_below_it_and_from_nothing_above(table):
    below, above = (table.loc[line, "net", "frequency", "all"] for line in ("y200", "y300"))
    bare = table.loc["y200", "bare", "frequency", "all"]
    assert below["difference"] == pytest.approx(below["value"] - bare["value"], rel=1e-9)
    assert below["difference_high"] < 0 and below["verdict"] == "less"
    assert above["difference"] == 0
    energies = table.xs("energy_by_period", level="quantity")["value"]
    assert (energies.loc["y200", "net"] <= energies.loc["y200", "bare"]).all()


def test_the_sum_over_scenarios_is_the_whole(case, table):
    alone = (case.replace(scenario=[scenario]) for scenario in SCENARIOS)
    parts = [by_row(yearly_variants(one, **PLACE).table) for one in alone]
    whole = table.xs("frequency", level="quantity")["value"]
    added = sum(part.xs("frequency", level="quantity")["value"] for part in parts)
    assert np.allclose(whole, added.loc[whole.index], rtol=1e-12)


def test_the_file_has_units_and_no_empty_differences(case):
    table = yearly_variants(case, **PLACE).table
    units = {"frequency": "year-1", "frequency_behind": "year-1", "energy_by_period": "J"}
    several, alone = (frequency_file(own) for own in (table, table[table["variant"] == "bare"]))
    assert (several["unit"] == several["quantity"].map(units)).all()
    assert {*several["quantity"]} == {*units}
    assert "difference" in several and "verdict" in several
    assert [*alone] == ["line", "variant", "quantity", "unit", "statistic", "n", "value",
                        "value_low", "value_high"]  # fmt: skip
