# SPDX-License-Identifier: BSD-3-Clause
"""Strength and relief of a ground as uncertain inputs, and inferred from observations."""

from dataclasses import replace

import numpy as np
import pytest

import rockfall
from made import make_raster
from programs import refuses
from rockfall.analysis.observed.observations import read_observed
from rockfall.result.crossings import line_values
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall.studies.back import study
from rockfall.studies.back.posterior import draws_table, posterior_table, ridges, warnings
from rockfall.studies.ensemble.uncertain_inputs import Uncertain, drawn_scene
from scenes import grid, make_case, rough, sets

TERRAIN = rough()
HOW = {"dem": TERRAIN, "transform": grid(TERRAIN)}
LINE = {"name": "L", "x": [0.0, 300.0], "y": [300.0, 300.0]}
HEAD = "name,model,strength,strength_sigma,relief,rest_angle,source\n"
GIVEN, TRUE = (2e5, 14.0), (3e5, 12.0)
FACTORS = {"strength_factor": 2.0, "relief_factor": 1.3}


def case_of(folder, pair=GIVEN, boulders=40, seed=77, **groups):
    """Scree slope with a given strength [Pa] and relief [degree]."""
    (folder / "own.csv").write_text(f"{HEAD}scree,ploughed,{pair[0]!r},0.5,{pair[1]!r},35,made\n")
    surface = {"ground": "scree", "ground_table": "own.csv"}
    return make_case(
        folder, *sets(), line=[LINE], terrain={}, surface=surface,
        release={"x": 150.0, "y": 380.0, "drop_height": 5.0},
        case={"boulders": boulders, "seed": seed, "threads": 1}, **groups,
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pairs")


@pytest.fixture(scope="module")
def found(gallery):
    """Posterior from 60 stopping places, and from speeds at a line."""
    return gallery.value("pairs", sought)


def sought(folder):
    truth = rockfall.run(case_of(folder, TRUE, boulders=60), **HOW)
    speed = line_values(truth, "speed", 0)
    seen = replace(
        read_observed(), stops=np.column_stack([truth["stop_x"], truth["stop_y"]]),
        samples={("L", "speed"): speed[np.isfinite(speed)]}, lines={"L": "made"},
    )  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "ROUND", 64)
        case = case_of(folder, boulders=150, seed=5, ensemble=FACTORS)
        return study.back_analysis(case, seen, members=192, enough=20, **HOW)


@pytest.mark.all
def test_the_pair_of_a_made_site_is_within_its_intervals(found):
    table = posterior_table(found).set_index("parameter")
    strength, relief = table.loc["strength of scree"], table.loc["relief of scree"]
    assert strength["q05"] < TRUE[0] < strength["q95"] and strength["units"] == "Pa"
    assert relief["q05"] < TRUE[1] < relief["q95"] and relief["units"] == "degree"
    assert (strength["case"], relief["case"]) == GIVEN
    assert max(strength["ratio"], relief["ratio"]) < 0.6
    assert strength["prior_q95"] == pytest.approx(GIVEN[0] * 2.0**1.645, rel=1e-3)
    assert strength["correlation"] == relief["correlation"] > 0.2


@pytest.mark.all
def test_speeds_alone_leave_a_ridge_of_strength_and_relief(found):
    """Speeds do not separate strength from relief: about 4 degrees more relief and twice the
    strength fit as well. The true strength is between the 5 and 95 % quantiles."""
    weight = found.alone[found.data["data"].tolist().index("speed at L")]
    alone = replace(found, members=found.members.assign(weight=weight))
    (ridge,) = ridges(alone)
    assert ridge.ground == "scree" and ridge.correlation > 0.7 and 2.5 < ridge.degrees < 6.5
    said = [text for text in warnings(alone) if text.startswith("scree: twice the strength")]
    assert len(said) == 1 and len(said[0].split()) <= 25 and "`rockfall ground`" in said[0]
    table = posterior_table(alone).set_index("parameter")
    assert table.loc["strength of scree"]["q05"] < TRUE[0] < table.loc["strength of scree"]["q95"]


@pytest.mark.all
def test_its_draws_are_those_of_an_ensemble(found, folder):
    draws = draws_table(found)
    assert [*draws] == ["draw", "strength_1", "relief_1"]
    draws.to_csv(folder / "draws.csv", index=False)
    case = case_of(folder, boulders=20, ensemble={"runs": 8, "draws": "draws.csv"})
    drawn = rockfall.run_ensemble(case, **HOW)
    which = drawn["drawn_draw"].values.astype(int)
    for key in "strength", "relief":
        assert np.allclose(drawn[f"drawn_{key}"].values[..., 0], draws[f"{key}_1"].values[which])


def test_a_draw_is_the_ground_of_a_table_with_its_numbers(folder):
    """A run of a draw is bit-identical to a run with a ground table of the same strength and
    relief. With factors of 1, boulders stop as in the case."""
    scene = read_scene(case_of(folder, ensemble=FACTORS), **HOW)
    inputs = Uncertain(scene)
    assert inputs.names == ["ground"]
    draw = inputs.draw("ground", 3, 0)
    strength, relief = (
        draw.kept[key].item() * of for key, of in zip(("strength", "relief"), GIVEN, strict=True)
    )
    one = run_scene(drawn_scene(scene, [draw], 77))
    other = rockfall.run(case_of(folder, (strength, relief)), **HOW)
    for name in set(other.variables):
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    same = inputs.at("ground", np.full(inputs.ends[-1], 0.5), 0)
    one, other = run_scene(drawn_scene(scene, [same], 77)), rockfall.run(case_of(folder), **HOW)
    np.testing.assert_array_equal(one["stop_x"], other["stop_x"])


def test_an_ensemble_keeps_what_it_drew_of_each_ground(folder):
    case = case_of(folder, boulders=20, ensemble={"runs": 8, "relief_factor": 1.2})
    drawn = rockfall.run_ensemble(case, **HOW)
    assert drawn["input"].values.tolist() == ["ground"]
    assert drawn["drawn_strength"].values.tolist() == np.ones((8, 2, 1)).tolist()
    assert len(np.unique(drawn["drawn_relief"])) == 16


BAD = {
    "ground = 'road', uniform_mean_radius = 0.2|strength_factor = 2.0": "case.nml: &ensemble "
    "strength_factor: has no effect: no ground has strength and relief: remove it",
    "ground = 'talus'|relief_factor = 1.2, sets = 'talus-ensemble'": "case.nml: &ensemble "
    "relief_factor: is not valid together with tables in sets, which replace grounds",
    "ground = 'talus'|strength_factor = 0.5": "case.nml: &ensemble strength_factor = 0.5: must be "
    "1 to 10",
}


@pytest.mark.parametrize("text", BAD)
def test_what_has_no_effect_is_refused(tmp_path, monkeypatch, capfd, text):
    monkeypatch.chdir(tmp_path)

    make_raster("dem.tif", TERRAIN.astype("f4"), nodata=-9999)
    surface, _, ensemble = text.partition("|")
    (tmp_path / "case.nml").write_text(
        f"&terrain dem = 'dem.tif' /\n&surface {surface} /\n&case boulders = 10 /\n"
        "&boulder volume_mean = 0.8 /\n&release x = 600050.0, y = 4999980.0, drop_height = 1.0 /\n"
        "&line name = 'L', x = 600000.0, 600100.0, y = 4999960.0, 4999960.0 /\n"
        f"&ensemble runs = 8, {ensemble} /\n"
    )
    refuses(["ensemble", "case.nml"], BAD[text], capfd)
