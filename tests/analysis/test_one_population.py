# SPDX-License-Identifier: BSD-3-Clause
"""A single population: scenarios sum to the total, a road as one segment equals the road as an
object, its pieces miss nothing, and a change without effect changes no value."""

import numpy as np
import pytest

import rockfall
import scenes
from made import leave_pictures_blank, make_layer
from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.cli import main
from rockfall.result.crossings import has_crossed
from rockfall.studies.dossier import read_dossier, run_dossier
from rockfall.text.summary import summary

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z = scenes.rough(ny=40, gradient=0.7, relief=0.5)
PLACE = {"dem": Z, "transform": scenes.grid(Z)}
ROAD = [[0.0, 90.0], [300.0, 90.0]]
NET = {"name": "net", "x": [0.0, 300.0], "y": [20.0, 20.0], "height": 4.0, "class": 3}
FREQUENCIES = ("frequency", "frequency_low", "frequency_high")

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


def one_of(seed, *more):
    """Seeds of a test: the first always, the others only with `--all`."""
    return [seed, *(pytest.param(one, marks=pytest.mark.all) for one in more)]


def random_case(folder, seed):
    """Case with two to four scenarios of random frequency and volume; also writes layers of objects
    and of a road."""
    random = np.random.default_rng(seed)
    scenarios = [
        {
            "name": f"scenario {k}",
            "frequency": float(random.lognormal(0.0, 2.0)),
            "volume_mean": float(random.uniform(0.05, 4.0)),
        }
        for k in range(random.integers(2, 5))
    ]
    groups = {
        "release": {"x": [120.0, 181.0], "y": [180.0, 185.0], "drop_height": 2.0},
        "case": {"boulders": int(random.integers(50, 200)), "seed": seed},
        "line": [{"name": "road", "x": [0.0, 300.0], "y": [90.0, 90.0]}],
    }
    case = scenes.make_case(folder, *scenes.sets(2.0), **groups)
    shapes = [shapely.box(130.0, 40.0, 160.0, 60.0), shapely.LineString(ROAD)]
    make_layer(folder / "houses.gpkg", shapes, crs=None, name=["house", "way"])
    make_layer(folder / "road.gpkg", [shapely.LineString(ROAD)], crs=None, name=["way"],
               width=[0.0])  # fmt: skip
    return case.replace(scenario=scenarios)


def hazard(case, length=60.0):
    layers = {"objects": case.path("houses.gpkg"), "segments": case.path("road.gpkg")}
    return rockfall.hazard(case, **layers, segment_length=length, **PLACE)


@pytest.mark.parametrize("seed", one_of(1, 2, 3))
def test_the_sum_over_scenarios_is_the_whole_and_segments_miss_nothing_of_the_road(tmp_path, seed):
    case = random_case(tmp_path, seed)
    whole = hazard(case)
    parts = [hazard(case.replace(scenario=[scenario])) for scenario in case.scenario]
    for kind in ("line", "object", "segment"):
        for name in FREQUENCIES:
            total = sum(part[f"{kind}_{name}"].values for part in parts)
            assert np.allclose(whole[f"{kind}_{name}"].values, total, rtol=1e-12)
    for name in ("hit_frequency", "passage_frequency"):
        total = sum(part[name].values for part in parts)
        assert np.allclose(whole[name].values, total, rtol=1e-5)
    single = hazard(case, None)["segment_passages"].values[:, 0]
    assert single.all() and (single == whole["object_passages"].sel(object="way")).all()
    pieces = whole["segment_passages"].values.sum(axis=1)
    assert (pieces >= single).all()  # a boulder at a joint hits two pieces
    assert (pieces <= 1.3 * single).all()
    assert (single >= whole["line_passages"].values[:, 0]).all()  # including the boulder's side


def test_zero_changes_change_nothing_and_a_variant_has_the_numbers_of_its_hazard(tmp_path):
    """A net below the road and the objects changes no frequency. Both variants have the frequencies
    of a hazard without variants."""
    variants = [{"name": "bare", "without": ["barrier"]}, {"name": "net"}]
    case = random_case(tmp_path, 4)
    both = case.replace(barrier=[NET], variant=variants)
    made = run_dossier(read_dossier(both, AtRisk(tmp_path / "houses.gpkg"), **PLACE))
    rows = made.frequencies[made.frequencies["line"] != "net"]
    changes = rows[rows["variant"] == "net"]["difference"].dropna()
    assert len(changes) and not changes.any()
    alone = hazard(case)
    for found in made.hazards.values():
        for kind, name in (("line", "road"), ("object", "house")):
            for end in FREQUENCIES:
                own, expected = (
                    float(one[f"{kind}_{end}"].sel({kind: name})) for one in (found, alone)
                )
                assert own == expected
        assert (found["line_energy_by_period"].values[0] == alone["line_energy_by_period"]).all()


@pytest.mark.parametrize("seed", one_of(6, 7, 8))
def test_every_product_has_the_same_numbers(tmp_path, seed):
    """Hazard, variants with a net below, dossier, siting, design, layers and answers agree."""
    case = random_case(tmp_path, seed)
    found = hazard(case)
    variants = [{"name": "bare", "without": ["barrier"]}, {"name": "net"}]
    of_variants = case.replace(barrier=[NET], variant=variants)
    dossier = run_dossier(
        read_dossier(of_variants, AtRisk(tmp_path / "houses.gpkg"), one_model=True, **PLACE)
    )
    tables = dossier.frequencies, rockfall.yearly_variants(of_variants, **PLACE).table
    site = rockfall.site(case, "road", every=40.0, to=40.0, factors=scenes.FACTORS, **PLACE)
    design = rockfall.yearly_design(found).loads.set_index("line")
    frames = rockfall.layers(found)
    by_name = {"road": frames["lines"].iloc[0], "house": frames["objects"].iloc[0]}
    for kind, name in (("line", "road"), ("object", "house")):
        three = [float(found[f"{kind}_{end}"].sel({kind: name})) for end in FREQUENCIES]
        curve = rockfall.exceedance(found, name)
        assert curve.iloc[0][["frequency", "low", "high"]].tolist() == three
        period = rockfall.return_period(found, name)
        with np.errstate(divide="ignore"):
            assert period == tuple(1 / np.array([three[0], three[2], three[1]]))
        assert [by_name[name][end] for end in FREQUENCIES] == three
        for table in tables:
            rows = table[(table["line"] == name) & (table["quantity"] == "frequency")]
            rows = rows[rows["statistic"] == "all"]
            assert len(rows) == (2 if name in {*table["line"]} else 0)
            assert np.allclose(rows["value"], three[0], rtol=1e-12)
            assert (rows["difference"].dropna() == 0).all()
    assert {*tables[0]["line"]} == {"road", "house", "way", "net"}
    assert {*tables[1]["line"]} == {"road", "net"}
    road = float(found["line_frequency"].sel(line="road"))
    share = site.table.set_index("alignment")["fraction"]["road"]
    assert share * found["frequency"].values.sum() == pytest.approx(road, rel=1e-12)
    assert design["frequency"]["road"] == road


@pytest.mark.parametrize("seed", one_of(9, 10))
def test_pieces_of_a_line_are_crossed_by_what_crosses_the_line(tmp_path, seed):
    """A returning boulder may cross two pieces, but counts once at the line."""
    case = random_case(tmp_path, seed)
    (road,) = case.line
    ends = [0.0, *np.sort(np.random.default_rng(seed).uniform(60, 240, 4)).tolist(), 300.0]
    pieces = [road | {"name": f"piece {k}", "x": [*ends[k : k + 2]]} for k in range(5)]
    case = case.replace(line=[road, *pieces])
    passages = rockfall.hazard(case, **PLACE)["line_passages"].values
    for counts, scenario in zip(passages, case.scenario, strict=True):
        boulder = {"volume_mean": scenario["volume_mean"]}
        result = rockfall.run(case.replace(boulder=boulder, scenario=[]), **PLACE)
        whole, *parts = (has_crossed(result, k) for k in range(6))
        assert counts.tolist() == [whole.sum(), *(part.sum() for part in parts)]
        assert (np.any(parts, axis=0) == whole).all() and whole.any()
        again = np.maximum(np.sum(parts, axis=0) - 1, 0).sum()
        assert counts[1:].sum() == counts[0] + again


@pytest.mark.all
def test_products_of_a_run_say_that_it_is_not_of_the_scenarios(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    pytest.importorskip("jinja2", reason="the report extra is not installed")
    said = "not of the scenarios: `rockfall hazard` gives their frequencies"
    case = random_case(tmp_path, 5)
    path = tmp_path / "out.nc"
    result = rockfall.run(case, **PLACE)
    assert said in summary(result)
    rockfall.write_result(result, path)
    for command in ("lines", "design"):
        assert main([command, str(path)]) == 0
        assert said in capsys.readouterr().out
    leave_pictures_blank(monkeypatch)
    page = rockfall.report(path, tmp_path / "page.html").read_text()
    assert said in page
    plain = rockfall.run(case.replace(scenario=[]), **PLACE)
    assert said not in rockfall.report(plain, tmp_path / "plain.html").read_text()
