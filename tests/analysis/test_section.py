# SPDX-License-Identifier: BSD-3-Clause
"""A section: at a station that is also an evaluation line boulders have the kernel's numbers."""

import numpy as np
import pytest

import rockfall
from made import refused
from rockfall.analysis.lines.section import COLUMNS, SectionLine, section_of
from scenes import grid, make_case, rough, sets

Z = rough()
TERRAIN = Z, grid(Z)
ROAD = {"name": "road", "x": [0.0, 300.0], "y": [180.0, 180.0]}
DOWN = np.array([150 + 400j, 150 + 20j])


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    case = make_case(
        tmp_path_factory.mktemp("section"), *sets(), terrain={}, line=[ROAD],
        output={"trajectories": 60},
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.2},
        release={"x": [100.0, 150.0, 200.0], "y": [380.0] * 3},
    )  # fmt: skip
    return rockfall.run(case, dem=Z, transform=TERRAIN[1])


def test_a_station_is_an_evaluation_line(result):
    found = section_of(result, SectionLine(DOWN, 150.0, 20.0), TERRAIN)
    assert list(found.table.columns) == COLUMNS
    here = found.passages[found.passages["distance"] == 220.0].set_index("boulder")
    recorded = np.isin(result["boulder"].values, result["trajectory_boulder"].values)
    crossed = np.isfinite(result["line_speed"].values[0]) & recorded
    assert found.recorded == 60 and crossed.sum() > 20
    assert sorted(here.index) == result["boulder"].values[crossed].tolist()
    here = here.loc[result["boulder"].values[crossed]]
    at_line = {
        name: result[f"line_{name}"].values[0] for name in ("speed", "jump_height",
        "passing_height", "energy_translational", "energy_rotational")
    }  # fmt: skip
    at_line["energy_total"] = at_line["energy_translational"] + at_line["energy_rotational"]
    for name in ("speed", "jump_height", "passing_height", "energy_total"):
        np.testing.assert_allclose(here[name], at_line[name][crossed], rtol=1e-10, atol=1e-10)
    row = found.table.set_index("distance").loc[220.0]
    assert row["energy_total_max"] == here["energy_total"].max()
    assert row["passing_height_q50"] == pytest.approx(np.median(here["passing_height"]))
    assert row["n"] == crossed.sum() and row["unknown_energy"] == 0


def test_mass_is_that_of_the_case_where_no_line_is_crossed(result):
    bare = result.drop_vars([name for name in result.data_vars if name.startswith("line_")])
    one, other = (section_of(of, SectionLine(DOWN, 150.0), TERRAIN).table for of in (result, bare))
    np.testing.assert_allclose(one["energy_total_max"], other["energy_total_max"], rtol=1e-10)
    named = bare.assign(source_feature=("boulder", np.zeros(bare.sizes["boulder"], int)))
    table = section_of(named, SectionLine(DOWN, 150.0), TERRAIN).table
    assert (table["unknown_energy"] == table["n"]).all() and table["energy_total_max"].isna().all()


def test_only_near_trajectories_count(result):
    near = section_of(result, SectionLine(DOWN, 5.0, 20.0), TERRAIN)
    far = section_of(result, SectionLine(DOWN, 150.0, 20.0), TERRAIN)
    assert (near.table["n"] <= far.table["n"]).all() and near.table["n"].sum() > 0
    assert near.table["n"].sum() < far.table["n"].sum()


def test_without_terrain_heights_are_unknown(result):
    table = section_of(result, SectionLine(DOWN, 150.0, 20.0)).table
    assert table["passing_height_q95"].isna().all() and table["elevation"].isna().all()
    assert table["energy_total_q95"].notna().any()


def test_refusals(result):
    with refused("within = 0.0: must be > 0 m"):
        section_of(result, SectionLine(DOWN, 0.0))
    with refused("every = 0.001: makes 380,000 stations, at most 10,000"):
        section_of(result, SectionLine(DOWN, 10.0, 0.001))
    with refused("section: must have a length above 0 m"):
        section_of(result, SectionLine(np.array([1 + 1j, 1 + 1j])))
    bare = result.drop_dims("trajectory_vertex")
    with refused("section: the result has no trajectories of boulders that moved: &output "
                 "trajectories"):  # fmt: skip
        section_of(bare, SectionLine(DOWN))
