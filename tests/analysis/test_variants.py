# SPDX-License-Identifier: BSD-3-Clause
"""Paired differences of variants: coverage of intervals, hand calculations, refusals."""

import numpy as np
import pytest
import rasterio

import rockfall
from made import make_raster, refused
from rockfall.analysis.precision.intervals import Sources
from rockfall.analysis.precision.paired import (
    difference,
    difference_of_fractions,
    mean_of,
    quantile_of,
)
from rockfall.cli import main
from rockfall.quantities import number
from rockfall.result.crossings import at_lines, line_names
from rockfall.studies.difference_maps import difference_maps
from rockfall.studies.variants import check_variant_scenes, compare_variants
from rockfall.tables.variants import comparison_notes, value_text, variant_table, variants_text
from scenes import case_in, grid, place, rough

Z = rough()


def run(case):
    return rockfall.run(case, dem=Z, transform=grid(Z))


def bare(folder, **changes):
    return case_in(folder, **place()).replace(**changes)


@pytest.fixture(scope="module")
def variants(tmp_path_factory):
    case = bare(tmp_path_factory.mktemp("variants"))
    net = {"name": "net", "x": [0.0, 300.0], "y": [330.0, 330.0], "height": 3.0, "capacity": 2000.0}
    return {"bare": run(case), "net": run(case.replace(barrier=[net]))}


def values_of(random, size, effect):
    """Correlated values of boulders in two variants: the second is `effect` times stronger, and NaN
    is for boulders that do not pass."""
    common, own = random.normal(0, 1, size), random.normal(0, 1, (2, size))
    strength = np.exp(0.6 * common + 0.3 * own)
    strength[1] *= effect
    return np.where(strength > 0.8, strength, np.nan)


@pytest.mark.all
@pytest.mark.parametrize("effect", [1.0, 0.8])
def test_intervals_of_differences_cover_them(effect):
    source = Sources.of(np.repeat(np.arange(5), 80))
    truth = values_of(np.random.default_rng(1), 2_000_000, effect)
    fractions = [np.mean(~np.isnan(one)) for one in truth]
    true = [fractions[1] - fractions[0]]
    true += [np.subtract(*(estimate(one).value for one in truth[::-1])) for estimate in ESTIMATES]
    inside, width, random = np.zeros(3), np.zeros(3), np.random.default_rng(2)
    for _ in range(TRIALS):
        before, here = values_of(random, source.number.size, effect)
        found = [difference_of_fractions(~np.isnan(here), ~np.isnan(before), source)]
        found += [difference(one(here), one(before), source) for one in ESTIMATES]
        for k, (_, low, high) in enumerate(found):
            inside[k] += low <= true[k] <= high
            width[k] += (high - low) / TRIALS
    assert (inside >= 0.92 * TRIALS).all(), inside / TRIALS
    assert (inside[:1] <= 0.985 * TRIALS).all(), inside / TRIALS


TRIALS = 300
ESTIMATES = mean_of, quantile_of


def test_boulders_in_common_make_intervals_narrower():
    source, random = Sources.alone(1000), np.random.default_rng(3)
    before, here = (~np.isnan(one) for one in values_of(random, 1000, 0.9))
    _, low, high = difference_of_fractions(here, before, source)
    _, apart_low, apart_high = difference_of_fractions(here, random.permutation(before), source)
    assert high - low < 0.75 * (apart_high - apart_low)


def test_newcombe_by_hand():
    """36 of 50 boulders pass in both variants, 12 only in the second, 2 only in the first: Wilson
    limits of 48/50 and 38/50, combined with the correlation of the pairs (Newcombe 1998, method
    10)."""
    here, before = (np.repeat(of, [36, 12, 2]).astype(bool) for of in ([1, 1, 0], [1, 0, 1]))

    def wilson(p, n=50, z=1.959964):
        half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        return np.array([-half, half]) / (1 + z**2 / n) + (p + z**2 / (2 * n)) / (1 + z**2 / n)

    phi = (36 * 0 - 12 * 2) / np.sqrt(48 * 2 * 38 * 12)
    (l1, u1), (l0, u0) = wilson(0.96), wilson(0.76)
    low = np.sqrt((0.96 - l1) ** 2 - 2 * phi * (0.96 - l1) * (u0 - 0.76) + (u0 - 0.76) ** 2)
    high = np.sqrt((u1 - 0.96) ** 2 - 2 * phi * (u1 - 0.96) * (0.76 - l0) + (0.76 - l0) ** 2)
    found = difference_of_fractions(here, before, Sources.alone(50))
    assert found == pytest.approx((0.2, 0.2 - low, 0.2 + high), abs=2e-3)


def test_what_equals_the_first_has_no_difference(variants):
    bare = variants["bare"]
    table = compare_variants({"bare": bare, "same": bare}).set_index("variant").loc["same"]
    assert (table["difference"] == 0).all()
    assert (table["verdict"] == "undecided").all()
    assert (table["difference_high"].dropna() < 0.02).all()


def test_a_net_lets_less_pass_at_it_and_below(variants):
    table = compare_variants(variants)
    first, *_ = table[table["variant"] == "bare"].itertuples()
    assert np.isnan(first.difference) and np.isnan(first.verdict)
    passing = table[(table["variant"] == "net") & (table["statistic"] == "fraction")]
    below = passing.set_index("line").loc["L"]
    outcome = at_lines(variants["net"])["barrier_outcome"].values
    came = ~np.isnan(at_lines(variants["net"])["line_speed"].values)
    stopped = (outcome == 1) & came
    assert stopped.any()
    at_net = passing.set_index("line").loc["net"]
    k = line_names(variants["net"]).index("net")
    assert at_net["n"] == (came[k] & ~stopped[k]).sum()
    assert below["difference_high"] < 0 and below["verdict"] == "less"
    assert np.isnan(at_net["difference"])  # the first variant has no such line
    text = variants_text(table, "a note")
    assert text.endswith("a note")
    assert "passing boulders [% of all]" in text and "with 30 kJ or more [% of all]" in text


def test_where_none_passes_the_upper_limit_is_told(tmp_path):
    """If no boulder passes, the table and the yearly value give "0 to" the upper limit."""
    above = [{"name": "above", "x": [0.0, 300.0], "y": [398.0, 398.0]}]
    result = run(bare(tmp_path, line=above + bare(tmp_path).line))
    table = compare_variants({"one": result, "two": result})
    none = table[(table["line"] == "above") & (table["quantity"] == "passing")]
    n = result.sizes["boulder"]
    assert (none["value"] == 0).all() and (none["value_low"] == 0).all()
    assert none["value_high"].values == pytest.approx(1.96**2 / (n + 1.96**2), rel=1e-3)
    high = none["value_high"].iloc[0]
    (shown,) = [row for row in variant_table(none[:2].drop_duplicates("variant")).rows]
    assert shown[1] == f"0 to {number(100 * high, up=True)}"
    assert value_text(none.iloc[0], 0.5) == f"0 to {number(0.5 * high, up=True)}"
    some = table[(table["line"] == "L") & (table["quantity"] == "passing")].iloc[0]
    assert some["value_low"] < some["value"] < some["value_high"]
    assert value_text(some, 1.0) == number(some["value"])


def test_a_threshold_of_zero_is_every_passage(variants):
    """A threshold of zero in the case adds no row, because it is the fraction that passes."""
    case = rockfall.case.case_of(variants["bare"]).replace(hazard={"thresholds": [0.0, 30.0]})
    bare = variants["bare"].assign_attrs(case=case.text())
    table = compare_variants({"bare": bare, "net": variants["net"]})
    passing = table[(table["line"] == "L") & (table["quantity"] == "passing")]
    assert passing["statistic"].tolist() == 2 * ["fraction", "above_30"]
    assert "passing boulders [% of all]" in variants_text(table)


def test_maps_of_difference(variants, tmp_path):
    maps = difference_maps(variants)
    counts = [one["passages"].values for one in variants.values()]
    boulders = variants["bare"].sizes["boulder"]
    expected = (counts[1] - counts[0].astype(float)) / boulders
    np.testing.assert_allclose(maps["net_passing"].values, expected, atol=1e-7)
    verdict = maps["net_verdict"].values
    assert {*np.unique(verdict)} <= {-1, 0, 1} and (verdict == -1).any()
    assert not ((verdict == -1) & (expected >= 0)).any()
    same = difference_maps({"bare": variants["bare"], "same": variants["bare"]})
    assert not same["same_verdict"].any()


def test_the_command(variants, tmp_path, capsys):
    files = []
    for name, result in variants.items():
        files.append(str(tmp_path / f"{name}.nc"))
        rockfall.write_result(result, files[-1])
    folder, table = tmp_path / "maps", tmp_path / "table.csv"
    assert main(["compare", *files, "-o", str(table), "--maps", str(folder)]) == 0
    assert "net" in capsys.readouterr().out
    assert table.read_text() == (folder / "differences.csv").read_text()
    with rasterio.open(folder / "net_passing.tif") as file:
        assert file.read(1).min() < 0


def test_a_line_in_two_places_is_told(variants, tmp_path):
    """A note reports a line that is 60 m farther up the slope in one variant: the difference is not
    due to protection."""
    case = bare(tmp_path)
    (line,) = case.line
    higher = run(case.replace(line=[line | {"y": [y + 60.0 for y in line["y"]]}]))
    assert not [note for note in comparison_notes(variants) if "elsewhere" in note]
    told = list(comparison_notes(variants | {"higher": higher}))
    assert told[1:] == [
        f"{line['name']} is elsewhere in higher than in bare: its difference compares two places."
    ]


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"case": {"boulders": 7}}, "number of boulders"),
        ({"case": {"seed": 9}}, "seed"),
        ({"boulder": {"volume_mean": 0.7}}, "sources or volumes"),
    ],
)
def test_other_boulders_are_refused(variants, tmp_path, changes, what):
    other = run(bare(tmp_path, **changes))
    with refused(
        f"b: is not a variant of bare: its {what} differs: run variants with the same sources, "
        "boulders and seed"
    ):
        compare_variants({"bare": variants["bare"], "b": other})


@pytest.mark.parametrize(("rows", "columns", "apart"), [
    (slice(None), slice(0, 50), 50), (slice(None), slice(10, None), 50),
    (slice(0, 70), slice(None), 50), (slice(0, 80), slice(0, 58), 10),
    (slice(None), slice(None), None), (slice(None), slice(0, 59), None),  # smaller by one cell
])  # fmt: skip
def test_a_variant_on_another_extent_is_told(tmp_path, rows, columns, apart):
    """Boulders leave a smaller terrain earlier, which looks like protection: a warning gives how
    far apart the edges are."""
    own, z = grid(Z), Z[:80, :60]
    place_of = own.transform * rasterio.Affine.translation(columns.start or 0, rows.start or 0)
    make_raster(tmp_path / "dem.tif", z, own.transform)
    make_raster(tmp_path / "other.tif", z[rows, columns] + 0.5, place_of)
    case = bare(tmp_path, terrain={"dem": "dem.tif"})
    case = case.replace(
        variant=[{"name": "today"}, {"name": "filled", "terrain_dem": "other.tif"}]
    )  # fmt: skip
    mine = [line for line in check_variant_scenes(case) if "its terrain ends" in line]
    text = f"variant filled: its terrain ends up to {apart} m from that of today, so boulders leave"
    assert [line.startswith(text) for line in mine] == [True] * bool(apart)
