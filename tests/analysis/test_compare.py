# SPDX-License-Identifier: BSD-3-Clause
"""Comparison with observations: values by hand and by SciPy, and one-line errors for bad files."""

import csv
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rockfall
from programs import refuses
from rockfall.analysis.observed.compare import compare
from rockfall.analysis.observed.observations import read_observed
from rockfall.analysis.observed.ranks import rank_results
from rockfall.cli import main
from rockfall.result.crossings import at_lines
from rockfall.tables.comparison import comparison_text as as_text
from rockfall.tables.comparison import ranks_text
from scenes import grid, make_case, rough, sets, status

stats = pytest.importorskip("scipy.stats", reason="the report extra is not installed")
VAUJANY = Path(__file__).parents[2] / "cases" / "vaujany"
NUMBERS = "line,quantity,unit,mean,std,max,n,method\n"
SAMPLES = "line,quantity,unit,value\n"


def make_run(folder, boulders=2000, **groups):
    """Result of a run with boulders that pass two lines, and a map of passages."""
    line = [{"name": name, "x": [0.0, 300.0], "y": [y, y]} for name, y in (("N", 330), ("S", 280))]
    groups = {"release": {"x": 150.0, "y": 380.0}, "output": {"maps": "passages"}} | groups
    case = make_case(
        folder, *sets(), line=line, case={"boulders": boulders, "threads": 0}, terrain={}, **groups
    )
    return rockfall.run(case, dem=rough(), transform=grid(rough()))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return make_run(tmp_path_factory.mktemp("one"))


@pytest.fixture(scope="module")
def file_of_result(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("one") / "r.nc"
    rockfall.write_result(result, path)
    return path


@pytest.fixture(scope="module")
def of_two(tmp_path_factory):
    """Result of a run from two sources."""
    release = {"x": [150.0, 170.0], "y": [380.0, 380.0]}
    return make_run(tmp_path_factory.mktemp("two"), boulders=500, release=release)


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def file(text, name="o.csv"):
    Path(name).write_text(text, "utf-8")
    return name


def at(result, quantity, line=0):
    values = at_lines(result)[f"line_{quantity}"].values[line]
    return values[np.isfinite(values)]


def samples(**values):
    """Observed values of boulders at line N."""
    return replace(read_observed(), samples={("N", name): v for name, v in values.items()})


# ---- input


def test_paper_is_read_as_it_is():
    seen = read_observed(VAUJANY / "paper.csv", VAUJANY / "paper_ks.csv")
    table = seen.summaries.set_index(["line", "method", "quantity"])
    with open(VAUJANY / "paper.csv", encoding="utf-8") as text:
        rows = list(csv.DictReader(text))
    assert len(table) == len(rows) == 20
    for row in rows:
        unit = 1000 if row["unit"] == "kJ" else 1
        for name in "mean", "std", "max":
            value = table.loc[(row["line"], row["method"], row["quantity"]), name]
            assert value == pytest.approx(unit * float(row[name] or "nan"), rel=1e-15, nan_ok=True)
    assert len(seen.tests) == 12 and not seen.samples
    assert seen.stops is seen.distances is seen.passing is None


def test_every_kind_is_known_by_its_header():
    seen = read_observed(
        file("unit;quantity;Line;mean;note\n\nkJ; energy_total ;N; 2.5;a\n", "1.csv"),
        file("\ufeff" + SAMPLES + "S,speed,m/s,3\nS,speed,m/s,1\nN,omega,rad/s,-2", "2.csv"),
        file("x,y,boulder\n1,2,a\n3,4,b\n", "3.csv"),
        file("distance\n30\n10\n", "4.csv"),
        file("distance,percent\n50,40\n20,90\n", "5.csv"),
        file("share,distance\n0.3,60\n", "6.csv"),
        file("line,method,quantity,p\nN,A,speed,0.01\n", "7.csv"),
    )  # fmt: skip
    (row,) = seen.summaries.to_dict("records")
    assert row.pop("mean") == 2500 and all(np.isnan(row.pop(name)) for name in ("std", "max", "n"))
    assert row == {"line": "N", "method": "observed", "quantity": "energy_total"}
    assert list(seen.samples) == [("S", "speed"), ("N", "omega")]
    assert seen.samples["S", "speed"].tolist() == [3, 1]
    assert seen.stops.tolist() == [[1, 2], [3, 4]] and seen.distances.tolist() == [10, 30]
    assert seen.passing.to_numpy() == pytest.approx(np.array([[20, 0.9], [50, 0.4], [60, 0.3]]))
    assert seen.tests.values.tolist() == [["N", "A", "speed", 0.01]]
    assert seen.lines == {"N": "1.csv: line 3", "S": "2.csv: line 2"}


HOSTILE = {
    "no kind": (
        "line,speed\nN,3\n",
        "o.csv: line 1: columns line, speed: must include one of: line, quantity, unit, mean | "
        "line, quantity, unit, value | line, method, quantity, p | impact, x, y | "
        "distance, fraction | distance, percent | distance, share | x, y | distance",
    ),
    "column twice": ("x,y,z,z\n1,2,3,3\n", "o.csv: line 1: column z occurs twice"),
    "half a release": ("x,y,start_x\n1,2,3\n",
        "o.csv: line 2: start_x = 3: needs start_x and start_y together"),
    "releases of some": ("x,y,start_x,start_y\n1,2,3,4\n1,2,,\n",
        "o.csv: line 3: start_x, start_y: must be given in all rows or in none"),
    "unknown quantity": (
        SAMPLES + "N,velocity,m/s,3\n",
        "o.csv: line 2: quantity = velocity: must be one of speed, jump_height, passing_height, "
        "omega, energy_translational, energy_rotational, energy_total, rotational_share",
    ),
    "unknown unit": (SAMPLES + "N,speed,km/h,3\n", "o.csv: line 2: unit = km/h: must be m/s"),
    "no number": (SAMPLES + "N,speed,m/s,3\n\nN,speed,m/s,fast\n",
        "o.csv: line 4: value = fast: must be a number >= 0"),
    "NaN": (SAMPLES + "N,omega,rad/s,nan\n", "o.csv: line 2: value = nan: must be a number"),
    "negative speed": (SAMPLES + "N,speed,m/s,-3\n",
        "o.csv: line 2: value = -3: must be a number >= 0"),
    "line missing": (SAMPLES + ",speed,m/s,3\n", "o.csv: line 2: line = : must not be empty"),
    "no numbers": (NUMBERS + "N,speed,m/s,,,,9,observed\n",
        "o.csv: line 2: mean = : a row needs mean, std or max"),
    "maximum below the mean": (NUMBERS + "N,speed,m/s,5,1,4,9,observed\n",
        "o.csv: line 2: max = 4: must be >= mean = 5"),
    "half a boulder": (NUMBERS + "N,speed,m/s,5,1,9,8.5,observed\n",
        "o.csv: line 2: n = 8.5: must be an integer"),
    "unknown method": (NUMBERS + "N,speed,m/s,5,1,9,8,C\n",
        "o.csv: line 2: method = C: must be one of observed, A, B"),
    "numbers twice": (NUMBERS + "N,speed,m/s,5,1,9,8,A\nN,speed,m/s,5,1,9,8,A\n",
        "o.csv: line 3: line N, method A, quantity speed: duplicates o.csv: line 2"),
    "fraction above 1": ("distance,fraction\n5,60\n",
        "o.csv: line 2: fraction = 60: must be a number >= 0 and <= 1"),
    "more boulders farther": ("distance,percent\n50,60\n20,30\n",
        "o.csv: line 2: fraction 0.6 at distance 50: must be <= 0.3, the fraction at distance 20"),
    "distance twice": ("distance,percent\n50,60\n50.0,30\n",
        "o.csv: line 3: distance 50.0: duplicates o.csv: line 2"),
    "unknown line": (SAMPLES + "N,speed,m/s,3\nT,speed,m/s,3\n",
        "o.csv: line 3: line T: is not in the result (lines: N, S)"),
    "of the other method": (NUMBERS + "N,speed,m/s,5,1,9,8,A\n",
        "o.csv: line 2: nothing to compare: row of method A, result of method B: run it with "
        "&surface method = 'A', or give observed rows."),
}  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize("name", HOSTILE)
def test_bad_observations_are_one_line_and_nothing_is_written(name, file_of_result, capfd):
    text, message = HOSTILE[name]
    shutil.copy(file_of_result, "r.nc")
    file(text)
    refuses(["compare", "r.nc", "o.csv", "-o", "t.csv"], re.escape(message), capfd)


ARGUMENTS = {
    "no observations": (["r.nc"],
        r"compare needs results \(.nc\) and observations \(CSV\), or variants \(.nc\)"),
    "a result twice": (["r.nc", "r.nc", "o.csv"], r"compare: a result is given twice"),
    "observations missing": (["r.nc", "no.csv"], r"no.csv: no such file or directory"),
    "observations twice": (["r.nc", "o.csv", "./o.csv"], r"o.csv: is given twice"),
    "table over the observations": (["r.nc", "o.csv", "-o", "./o.csv"],
        r"o.csv: is an input; not overwritten"),
}  # fmt: skip


@pytest.mark.parametrize("name", ARGUMENTS)
def test_bad_arguments_are_one_line_and_nothing_is_written(name, file_of_result, capfd):
    words, message = ARGUMENTS[name]
    shutil.copy(file_of_result, "r.nc")
    file(SAMPLES + "N,speed,m/s,3\n")
    refuses(["compare", *words], message, capfd)


# ---- comparison


def test_errors_are_those_of_a_hand(result):
    rows = (
        "S,speed,m/s,8,2,20,,observed\nS,speed,m/s,10,3,,,B\nN,energy_translational,kJ,100,,,,A\n"
    )
    errors = compare(result, file(NUMBERS + rows)).errors
    assert set(errors["line"]) == {"S"} and set(errors["against"]) == {"observed", "B"}
    v = at(result, "speed", line=1)
    ours = {"mean": v.mean(), "std": v.std(ddof=1), "max": v.max()}
    errors = errors.set_index(["against", "statistic"])
    for (against, name), value in {
        ("observed", "mean"): 8, ("observed", "std"): 2, ("observed", "max"): 20,
        ("B", "mean"): 10, ("B", "std"): 3,
    }.items():  # fmt: skip
        row = errors.loc[(against, name)]
        assert row["observed"] == value and row["simulated"] == pytest.approx(ours[name])
        assert row["error_percent"] == pytest.approx(100 * (ours[name] - value) / value)
    half = stats.t.ppf(0.975, v.size - 1) * ours["std"] / np.sqrt(v.size)
    mean = errors.loc[("observed", "mean")]
    sides = [ours["mean"] - mean["simulated_low"], mean["simulated_high"] - ours["mean"]]
    assert sides == pytest.approx([half, half], rel=0.05)  # with many boulders; the rest is skew
    assert errors.loc[("B", "mean"), "printed_error_percent"] == pytest.approx(25)
    assert errors.loc[("B", "std"), "printed_error_percent"] == pytest.approx(50)
    assert np.isnan(errors.loc[("B", "max"), "error_percent"])
    assert pd.isna(errors.loc[("observed", "max"), "within_interval"])  # a maximum has no interval


def test_the_method_of_the_result_chooses_among_the_printed(result):
    """Printed values are those of the case's method, or of the default method if the case has
    none."""
    seen = read_observed(file(NUMBERS + "N,speed,m/s,8,2,20,,A\nN,speed,m/s,9,2,20,,B\n"))
    text = result.attrs["case"]
    assert "method = 'B'" in text
    for of, method in (("method = 'A', uniform_rg = 3*0.5", "A"), ("! of the site", "B")):
        other = result.assign_attrs(case=text.replace("method = 'B'", of))
        assert set(compare(other, seen).errors["against"]) == {method}


def test_table_3_follows_from_table_2(result):
    """Relative differences of method B from observations, as printed in table 3: mean, deviation
    and maximum of speed at EL1 +2, -17, +8 %; mean energy at EL2 -16 %."""
    text = (VAUJANY / "paper.csv").read_text().replace("EL1", "N").replace("EL2", "S")
    errors = compare(result, file(text)).errors
    errors = errors[errors["against"] == "B"].set_index(["line", "quantity", "statistic"])
    theirs = errors["printed_error_percent"]
    expected = [100 * (a / b - 1) for a, b in ((12.7, 12.5), (4.3, 5.2), (30.3, 28.1))]
    assert [theirs[("N", "speed", name)] for name in ("mean", "std", "max")] == pytest.approx(
        expected
    )
    assert theirs[("S", "energy_translational", "mean")] == pytest.approx(100 * (207 / 245 - 1))
    assert np.isnan(theirs[("N", "rotational_share", "mean")])  # not observed


def test_an_observed_mean_has_the_interval_of_its_n(result):
    """An observed mean with a sample size has an interval. If its half width equals that of the
    simulated mean, h, that of the difference is sqrt(2) h."""
    v = at(result, "speed")
    std, n = v.std(ddof=1), v.size
    assert n > 500  # Student's t is almost normal
    half = 1.959964 * std / np.sqrt(n)
    for away, holds, alone, together in (
        (0.9, True, True, True), (-1.3, False, False, True), (1.3, False, False, True),
        (-1.5, False, False, False), (1.5, False, False, False),
    ):  # fmt: skip
        value = v.mean() + away * half
        rows = f"N,speed,m/s,{value},{std},,,observed\nN,speed,m/s,{value},{std},,{n},B\n"
        exact, mean = (
            compare(result, file(NUMBERS + rows)).errors.iloc[k].to_dict() for k in (0, 3)
        )
        assert exact["within_interval"] == mean["within_interval"] == holds
        assert (exact["consistent"], mean["consistent"]) == (alone, together)
        assert np.isnan(exact["observed_low"])
        assert mean["observed_low"] == pytest.approx(value - half, rel=1e-3)
        assert mean["observed_high"] == pytest.approx(value + half, rel=1e-3)


def test_kolmogorov_smirnov_is_scipys(result):
    rng = np.random.default_rng(1)
    speed, height = at(result, "speed"), at(result, "passing_height")
    seen = {"speed": rng.normal(speed.mean(), 2, 60), "passing_height": rng.gamma(2, 1, 300)}
    distances = np.sort(rng.uniform(0, 300, 90))
    ks = compare(result, replace(samples(**seen), distances=distances)).ks.set_index("quantity")
    run_out = result["plan_distance"].values
    for name, observed, ours in (
        ("speed", seen["speed"], speed),
        ("passing_height", seen["passing_height"], height),
        ("stopping_distance", distances, run_out),
    ):
        scipys = stats.ks_2samp(observed, ours)
        row = ks.loc[name]
        assert (row["ks_statistic"], row["p"]) == (scipys.statistic, scipys.pvalue)
        assert (row["n_observed"], row["n_simulated"]) == (observed.size, ours.size)


def test_boulders_of_ours_are_not_rejected_and_faster_ones_are(result):
    speed = np.random.default_rng(2).choice(at(result, "speed"), 150, replace=False)
    same, faster = (compare(result, samples(speed=v)) for v in (speed, 1.3 * speed))
    assert same.ks["p"][0] > 0.05 > faster.ks["p"][0]
    chance = [c.errors.set_index("statistic")["consistent"]["mean"] for c in (same, faster)]
    assert chance == [True, False]
    assert "not rejected" in as_text(same) and "not rejected" not in as_text(faster)


@pytest.mark.all
def test_chance_is_right_95_times_in_100(result):
    """20 samples of 120 boulders are compared with 500 others of the same distribution: at least 17
    are consistent in mean and in standard deviation."""
    rng = np.random.default_rng(3)
    found = []
    for _ in range(20):
        ours, theirs = np.split(rng.permutation(2000), [500])
        speed = at(result.isel(boulder=theirs), "speed")[:120]
        errors = compare(result.isel(boulder=ours), samples(speed=speed)).errors
        found.append(errors["consistent"][:2].to_list())
    right = np.mean(found, axis=0)
    assert right.min() >= 0.85  # mean, deviation: may be wrong once or twice in 20


def test_run_out_is_the_share_that_comes_as_far(result):
    ours = result["plan_distance"].values
    table = compare(result, file("distance,percent\n0,100\n60,70\n5000,0\n")).passing
    assert table["distance"].to_list() == [0, 60, 5000]
    assert table["simulated"].to_list() == [1, np.mean(ours >= 60), 0]
    assert table["difference_percent"][1] == pytest.approx(100 * np.mean(ours >= 60) - 70)
    assert table["observed_low"].isna().all()
    assert table["within_interval"].to_list()[::2] == [True, True]
    gone = status(result).count("left_domain")
    assert gone and f"{gone:,} boulders never came to rest" in as_text(compare(result, "o.csv"))
    one = replace(read_observed(), distances=ours[:1])
    assert compare(result, one).passing["simulated"][0] == np.mean(ours >= ours[0])
    table = compare(result, file("distance\n80\n40\n80\n60\n")).passing
    assert table["distance"].to_list() == [40, 60, 80]
    assert table["observed"].to_list() == [1, 0.75, 0.5]
    assert (table["observed_low"] < table["observed"]).all()


def test_stopping_places_give_reach_and_distances(result):
    """Reach probabilities at four stopping places: in a map cell with known passages, in an empty
    cell, and beyond two edges."""
    passages = result["passages"].values
    row, column = np.unravel_index(passages.argmax(), passages.shape)
    x, y = 5.0 * column + 4.9, 400 - 5.0 * row - 4.9  # corner of the cell
    found = compare(result, file(f"x,y\n{x},{y}\n1,1\n-0.1,300\n150,1e300\n"))
    reach = found.stops["reach_probability"].to_list()
    assert reach[:2] == [passages.max() / 2000, passages[-1, 0] / 2000] and reach[1] == 0
    assert np.isnan(reach[2:]).all()
    assert np.hypot(x - 150, y - 380) in found.passing["distance"].to_list()
    text = [" ".join(line.split()) for line in as_text(found).splitlines()]
    assert {"10 % of the boulders or more pass 1", "none passes 1"} <= set(text)
    assert "are outside the map 2" in text
    upside_down = result.isel(y=slice(None, None, -1))
    assert compare(upside_down, "o.csv").stops.equals(found.stops)


def test_several_sources_are_said(of_two):
    found = compare(of_two, samples(speed=at(of_two, "speed")[:50]))
    assert "Boulders from the same source (2 sources) are dependent" in as_text(found)
    found = compare(of_two, file("x,y\n150,300\n"))
    assert len(found.stops) == 1 and not len(found.passing) and not len(found.ks)
    assert "No distances: the source of each" in as_text(found)


def test_without_a_map_places_give_distances_alone(result, of_two):
    file("x,y\n150,300\n")
    found = compare(result.drop_vars("passages"), "o.csv")
    assert not len(found.stops) and found.passing["distance"].to_list() == [80]
    assert "&output maps = 'passages'" in as_text(found)
    found = compare(of_two.drop_vars("passages"), "o.csv")  # only the density of stops is left
    assert not len(found.stops) and not len(found.passing) and len(found.at_rest)


def test_a_line_that_nobody_crossed_has_no_numbers(result):
    nobody = result.isel(crossing=slice(0)).assign(row_size=0 * result["row_size"])
    found = compare(nobody, samples(speed=np.array([3.0, 4.0])))
    assert found.errors["simulated"].isna().all() and found.errors["within_interval"].isna().all()
    assert found.ks["n_simulated"][0] == 0 and np.isnan(found.ks["p"][0])
    assert "N: speed [m/s]" in as_text(found)


def test_few_observed_boulders_leave_much_to_chance(result):
    """With fewer than 10 boulders, sampled or printed, a mean has no interval and no verdict. From
    10 on it has both, and its limits are not below those of Student's t."""
    speeds = np.array([3.0, 4.0, 4.5, 5.0, 6.0, 6.5, 7.0, 8.0, 9.5, 13.0])
    low, high = stats.t.interval(0.95, 9, speeds.mean(), stats.sem(speeds))
    for n in (9, 10):
        v = speeds[:n]
        printed = f"N,speed,m/s,{v.mean()},{v.std(ddof=1)},,{n},observed\n"
        for seen in (samples(speed=v), file(NUMBERS + printed)):
            mean, deviation, _ = compare(result, seen).errors.itertuples()
            assert pd.isna(mean.consistent) == (n < 10) and pd.isna(deviation.consistent)
            assert np.isnan([mean.observed_low, mean.observed_high]).all() == (n < 10)
            assert n < 10 or (mean.observed_high > high and mean.observed_low >= low - 1e-9)
    for one in (samples(speed=np.array([0.1])), file(NUMBERS + "N,speed,m/s,0.1,,,1,observed\n")):
        found = compare(result, one)
        assert pd.isna(found.errors["consistent"][0]) and "significant" not in as_text(found)


# ---- run-out, impacts, ranks


def made_stops(result, n, stretch=1.0, first=0):
    """Observed stops made from `n` simulated boulders; distances from the release are multiplied by
    `stretch`."""
    some = result.isel(boulder=slice(first, first + n))
    start, stop = (
        np.column_stack([some[f"{of}_{axis}"] for axis in "xy"]) for of in ("start", "stop")
    )
    return replace(read_observed(), stops=start + stretch * (stop - start), starts=start)


def test_run_out_has_the_numbers_of_numpy_and_scipy(result):
    table = compare(result, made_stops(result, 120)).run_out.set_index("statistic")
    ours, theirs = result["plan_distance"].values, result["plan_distance"].values[:120]
    mean, std, far = (table.loc[name] for name in ("mean", "std", "wasserstein"))
    assert mean["difference"] == pytest.approx(ours.mean() - theirs.mean(), abs=0.01)
    assert std["observed"] == pytest.approx(theirs.std(ddof=1), abs=0.01)
    assert far["difference"] == pytest.approx(stats.wasserstein_distance(theirs, ours), abs=0.01)
    half = 1.96 * np.hypot(theirs.std() / np.sqrt(120), ours.std() / np.sqrt(2000))
    width = mean["difference_high"] - mean["difference_low"]
    assert width == pytest.approx(2 * half, rel=0.25)
    low, value, high = (table[f"difference{end}"] for end in ("_low", "", "_high"))
    assert (low <= value).all() and (value <= high).all()


def test_few_stops_are_no_reason_to_call_a_run_out_longer(result):
    """A mean has an interval for ten observed stops, but not for nine; a standard deviation has
    none for fewer than 100."""
    for n, known in ((9, []), (10, ["mean", "lateral_offset"])):
        table = compare(result, made_stops(result, n, 1.5)).run_out.set_index("statistic")
        moments = table.drop("wasserstein")
        assert moments.index[moments["difference_low"].notna()].tolist() == known
        assert (moments["verdict"].drop(known) == "undecided").all()
        assert "(–)" in as_text(compare(result, made_stops(result, n)))


def test_offsets_are_across_the_way_to_the_mean_stop(result):
    seen = made_stops(result, 200)
    way = seen.stops - seen.starts
    along = way.mean(axis=0) / np.hypot(*way.mean(axis=0))
    offset = way @ np.array([-along[1], along[0]])
    table = compare(result, seen).run_out.set_index("statistic")
    assert table.loc["lateral_spread", "observed"] == pytest.approx(offset.std(ddof=1))
    assert table.loc["lateral_offset", "observed"] == pytest.approx(0, abs=1e-9)


def test_what_chance_can_do_is_undecided_and_more_is_not(result):
    same = compare(result, made_stops(result, 60)).run_out.set_index("statistic")["verdict"]
    far = compare(result, made_stops(result, 60, 1.5)).run_out.set_index("statistic")["verdict"]
    assert same["mean"] == same["wasserstein"] == "undecided"
    assert far["mean"] == "smaller" and far["wasserstein"] == "differs"


def test_sources_are_compared_each_with_its_own(of_two):
    """Each source is compared with its own boulders only; totals weight the sources as observed."""
    seen = made_stops(of_two, 60, first=470)
    assert (np.unique(seen.starts, axis=0, return_counts=True)[1] == 30).all()
    table = compare(of_two, seen).run_out.set_index(["source", "statistic"])
    distance = of_two["plan_distance"].values
    for name, own in (("1", distance[:500]), ("2", distance[500:])):
        assert table.loc[(name, "mean"), "simulated"] == pytest.approx(own.mean())
        assert table.loc[(name, "mean"), "n_simulated"] == 500
    one = made_stops(of_two, 30, first=470)
    table = compare(of_two, one).run_out.set_index(["source", "statistic"])
    assert table.loc[("all", "mean"), "simulated"] == pytest.approx(distance[:500].mean())


def test_impacts_stand_beside_what_passes_their_cells(tmp_path):
    output = {"maps": ["passages", "speed_max_map", "speed_mean"]}
    result = make_run(tmp_path, 500, output=output)
    row, column = np.unravel_index(result["passages"].values.argmax(), result["passages"].shape)
    x, y = 5.0 * column + 2.5, 400 - 5.0 * row - 2.5
    text = f"impact,x,y,speed,tree\n1,{x},{y},99,fir\n2,1,1,,\n"
    found = compare(result, file(text))
    assert found.contacts["speed_max_map"][0] == result["speed_max_map"].values[row, column] < 99
    assert found.contacts["reach_probability"][1] == 0
    assert found.contacts["tree"].to_list() == ["fir", ""]
    said = " ".join(as_text(found).split())
    assert "speed above the maximum of all passing boulders (1 known values) 1" in said
    assert "Columns kept but not read: tree." in said


def test_ranks_know_the_nearer_and_do_not_part_the_same(result, tmp_path):
    slow = result.assign(plan_distance=0.5 * result["plan_distance"])
    seen = replace(read_observed(), distances=np.sort(result["plan_distance"].values[:50]))
    table = rank_results({"slow": slow, "own": result, "again": result}, seen)
    table = table.set_index("result")
    assert table.loc["slow", ["rank", "rank_low", "rank_high"]].to_list() == [3, 3, 3]
    for name in ("own", "again"):
        assert table.loc[name, ["rank_low", "rank_high"]].to_list() == [1, 2]
    assert "undecided: 1 to 2" in ranks_text(table.reset_index())


def test_several_results_are_ranked_by_the_command(result, file_of_result, capsys):
    shutil.copy(file_of_result, "a.nc")
    rockfall.write_result(make_run(Path(), 500), "b.nc")
    file(SAMPLES + "".join(f"N,speed,m/s,{v}\n" for v in at(result, "speed")[:30]))
    assert main(["compare", "a.nc", "b.nc", "o.csv", "-o", "ranks.csv"]) == 0
    table = pd.read_csv("ranks.csv")
    assert table["measure"].to_list() == ["N.speed"] * 2 and "N.speed" in capsys.readouterr().out
    theirs = stats.wasserstein_distance(at(result, "speed")[:30], at(result, "speed"))
    assert table.set_index("result").loc["a.nc", "distance"] == pytest.approx(theirs, rel=1e-4)


# ---- the command


def test_command_prints_and_writes_every_table(result, file_of_result, capsys):
    shutil.copy(file_of_result, "r.nc")
    file(NUMBERS + "N,speed,m/s,12.5,5,30,,observed\n", "a.csv")
    file("line,method,quantity,p\nN,B,speed,0.0366\nN,A,speed,0.9\n", "b.csv")
    assert main(["compare", "r.nc", "a.csv", "b.csv", "-o", "t.csv"]) == 0
    out, err = capsys.readouterr()
    found = compare(rockfall.read_result("r.nc"), "a.csv", "b.csv")
    assert out == f"{as_text(found)}\n"
    assert all(line.startswith("rockfall: warning: ") for line in err.splitlines())
    v = at(result, "speed")
    lines = iter(out.splitlines())
    row = next(line.split() for line in lines if line.startswith("N: speed"))
    half = 1.959964 * v.std(ddof=1) / np.sqrt(v.size)
    assert row[3:6] == [f"{v.mean():.1f}", f"{v.std():.1f}", f"{v.max():.1f}"]
    ends = [float(number) for number in next(lines).strip(" ()").split("–")]
    assert ends == pytest.approx([v.mean() - half, v.mean() + half], abs=0.1)
    assert row[6:10] == ["observed", "12.5", "5", "30"]
    assert row[10].rstrip("*") == f"{100 * (v.mean() / 12.5 - 1):+.0f}"
    assert "0.0366" in out and "0.9" not in out.split("Kolmogorov")[1]
    table = pd.read_csv("t.csv")
    assert table["table"].to_list() == ["errors"] * 3 + ["ks"]
    assert table["error_percent"][0] == pytest.approx(100 * (v.mean() / 12.5 - 1))
    assert table["printed_p"][3] == 0.0366
    assert not list(Path().glob(".*"))
