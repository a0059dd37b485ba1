# SPDX-License-Identifier: BSD-3-Clause
"""Design sheet: values calculated by hand, and a barrier that performs as designed."""

import math
import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rockfall
from made import refused
from rockfall.analysis.line_statistics import sample_numbers
from rockfall.analysis.precision.intervals import Sources, quantile
from rockfall.case import case_of
from rockfall.cli import main
from rockfall.kernel_rules import EAD_ENERGY
from rockfall.language import speaking
from rockfall.protection.crossings import Crossings, crossings, passes
from rockfall.protection.demand import ABOVE, class_for, demand
from rockfall.protection.factors import DECIDES, NEEDED, Conditions, read_factors
from rockfall.protection.selection import cheapest, choices, height_for, least_heights, read_costs
from rockfall.quantities import number
from rockfall.result.crossings import at_lines
from rockfall.table import as_text
from rockfall.tables.design import check_row, choice_table, demand_rows, design_text, factor_lines
from scenes import FACTORS, grid, make_case, rough, sets

design = partial(rockfall.design, factors=FACTORS)
WELL_KNOWN = {"survey": "good", "blocks": "good", "calibration": "back-analysed"}
LINE = {"name": "road", "x": [0.0, 300.0], "y": [280.0, 280.0]}
BOULDERS = 600


def known(*standard, **conditions):
    return read_factors(Conditions(*standard, **conditions), FACTORS)


def run(folder, z=None, barrier=(), **groups):
    z = rough() if z is None else z
    groups = {
        "case": {"boulders": BOULDERS, "threads": 0},
        "boulder": {"volume": "normal", "volume_mean": 0.8, "volume_std": 0.2},
        "release": {"x": [100.0, 150.0, 200.0], "y": [380.0, 380.0, 380.0]},
        "line": [LINE],
    } | groups
    case = make_case(folder, *sets(), terrain={}, **groups).replace(barrier=list(barrier))
    return rockfall.run(case, dem=z, transform=grid(z))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run(tmp_path_factory.mktemp("case"))


@pytest.fixture
def file(result, tmp_path):
    path = tmp_path / "out.nc"
    rockfall.write_result(result, path)
    return path


def equal(n=100, **values):
    """Identical boulders of 2600 kg/m3 at a line; `values` replace usual values."""
    usual = {"volume": 1.0, "position": 5.0, "speed": 20.0, "energy_total": 5e5,
             "energy_translational": 5.2e5, "passing_height": 3.0, "upper_edge": 3.6,
             "normal_height": 2.5, "normal_upper_edge": 3.1}  # fmt: skip
    columns = {name: np.full(n, value) for name, value in (usual | values).items()}
    return Crossings(source=Sources.alone(n), **columns)


def drawn(n, seed=3):
    """Boulders at a line with correlated, skewed energies and heights."""
    random = np.random.default_rng(seed)
    common = random.normal(size=n)
    energy = 4e5 * np.exp(0.8 * common + 0.3 * random.normal(size=n))
    height = 2 * np.exp(0.6 * common + 0.4 * random.normal(size=n))
    return equal(n, energy_total=energy, passing_height=height)


def test_uni_by_hand():
    """Boulders of 1 m3 (2600 kg/m3) have 20 m/s and a passing height of 3 m; conditions are well
    known."""
    row = demand(equal(), known(**WELL_KNOWN), 2600.0)
    assert row["v_d"] == pytest.approx(20.808)  # 20 x 1.02 x 1.02
    assert row["m_d"] == pytest.approx(2652.0)  # 2600 x 1.02 x 1.00
    assert row["E_d"] == pytest.approx(574_122.0, abs=0.1)  # 2652 x 20.808^2 / 2
    assert row["h_d"] == pytest.approx(3.1212)
    assert row["f_min"] == pytest.approx(0.620350)  # radius of 1 m3, more than 0.5 m
    assert row["height_needed"] == pytest.approx(3.741550)
    assert row["normal_height_needed"] == pytest.approx(2.5 * 1.0404 + 0.620350)
    assert row["ead_class"] == 3  # 574 kJ < 1000 / 1.2, but not < 500 / 1.2


def test_what_is_not_known_costs_more():
    row = demand(equal(), known(), 2600.0)
    assert row["E_d"] == pytest.approx(0.5 * 2860 * 24.2**2)
    assert row["h_d"] == pytest.approx(3.63)
    assert row["ead_class"] == 4  # 837 kJ > 1000 / 1.2


def test_the_mass_is_that_of_the_densest_boulder_that_came():
    """Mass and energy are those of the densest boulder, 3900 kg/m3, whatever the density of the
    case. Boulders at rest have the density of the case."""
    factors = known(**WELL_KNOWN)
    energy = np.where(np.arange(100) == 7, 1.5, 1.0) * 5.2e5  # one boulder has 3900 kg/m3
    for density in 2600.0, 1000.0, 5000.0:
        row = demand(equal()._replace(energy_translational=energy), factors, density)
        assert row["m_d"] == pytest.approx(3900 * 1.02)
        assert row["E_d"] == pytest.approx(1.5 * 574_122.0, rel=1e-6)
    resting = equal(speed=0.0, energy_translational=0.0)
    assert demand(resting, factors, 2600.0)["m_d"] == pytest.approx(2652.0)


def test_onr_by_hand():
    row = demand(equal(), known("ONR", consequence="CC3"), 2600.0)
    assert row["E_d"] == pytest.approx(575_000)  # the total energy x 1.15
    assert row["h_d"] == pytest.approx(3.9)
    assert row["ead_class"] == 3


def test_the_free_border_is_half_a_metre_of_small_blocks():
    row = demand(equal(), known(**WELL_KNOWN), 2600.0, volume=0.1)
    assert row["f_min"] == 0.5
    assert row["m_d"] == pytest.approx(265.2)


@pytest.mark.family(2)
@pytest.mark.parametrize(("volume", "is_far"), [(500.0, True), (0.001, True), (2.0, False)])
def test_a_design_block_far_from_the_boulders_is_told(result, volume, is_far):
    told = [text for text in design(result, volume=volume).warnings if "block" in text]
    assert len(told) == is_far
    assert not is_far or told[0].startswith(f"the design block has {volume:g} m3, but its ")
    assert not [text for text in design(result).warnings if "design block" in text]


def test_classes_are_those_of_the_kernel():
    energies = [100, 250, 500, 1000, 1500, 2000, 3000, 4500]
    assert [energy / 1000 for energy in EAD_ENERGY] == energies
    mel = known()
    sel = known(limit_state="SEL")
    assert class_for(83.3e3, mel) == 0 and class_for(100e3 / 1.2, mel) == 1
    assert class_for(333e3, sel) == 3 and class_for(334e3, sel) == 4
    assert class_for(10e3, sel) == 1  # class 0 has no SEL
    assert class_for(3751e3, mel) == ABOVE == 8
    assert math.isnan(class_for(math.nan, mel))


def test_without_factors_the_sheet_lists_what_to_fill_in(file, tmp_path, capsys):
    """Loads and choices are those of a sheet with factors; the check of a barrier is undecided."""
    net = run(tmp_path, line=[], barrier=[LINE | {"height": 90.0, "class": 7}])
    sheet, full = rockfall.design(net), design(net)
    assert sheet.loads.equals(full.loads) and sheet.choices.equals(full.choices)
    assert sheet.demand["E_d"].isna().all() and sheet.demand["ead_class"].isna().all()
    row = sheet.checks.iloc[0]
    assert row["verdict"] == "undecided: height, energy" and row["over"] == full.checks["over"][0]
    conditions = {"gamma_E": "MEL", "energy_share": "MEL", "gamma_tr": "literature"}
    conditions |= dict.fromkeys(("gamma_dp", "gamma_vol"), "poor")
    names = [f"{name} ({conditions[name]})" if name in DECIDES else name for name in NEEDED["UNI"]]
    for language, begins in (("en", "Requirements of UNI not computed"),
                             ("de", "Anforderungen nach UNI nicht"),
                             ("fr", "Exigences selon UNI non calculées"),
                             ("it", "Requisiti secondo UNI non calcolati")):  # fmt: skip
        with speaking(language):
            (line,) = factor_lines(sheet.factors)
        assert line.startswith(begins) and line.endswith(f": {', '.join(names)}")
        assert "(--factors" in line
    folder = tmp_path / "open"
    assert main(["design", str(file), "-o", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "Requirements of UNI not computed" in said and "E_d" not in said
    table = pd.read_csv(folder / "design_factors.csv")
    assert table["factor"].tolist() == NEEDED["UNI"] and table["value"].isna().all()
    given = pd.read_csv(FACTORS).drop(columns=["value", "source"])
    assert len(table.merge(given)) == len(table)  # each row is part of a complete table
    unfilled = str(folder / "design_factors.csv")
    assert main(["design", str(file), "--factors", unfilled]) == 2
    assert f"{unfilled}: line 2: value = : must be a number" in capsys.readouterr().err
    needs = f"needs --factors TABLE.csv, with UNI: {', '.join(names)}"
    with refused(f"along road {needs}"):
        rockfall.design(net, along="road")
    with refused(f"site {needs}"):
        rockfall.site(case_of(net), "road")


def test_quantiles_are_those_of_line_statistics(result):
    came = crossings(result, 0)
    row = sample_numbers(came.speed, came.source)
    for level in (50, 95):
        theirs = [row[f"q{level}{end}"] for end in ("", "_low", "_high")]
        np.testing.assert_array_equal(quantile(came.speed, level / 100, came.source), theirs)


def test_normal_heights_are_those_above_a_plane(tmp_path):
    south = np.arange(80)[::-1, None] * 5.0
    z = 1000 + 0.75 * south + np.zeros((1, 60))  # cosine 0.8
    came = crossings(run(tmp_path, z), 0)
    assert came.n > 100
    np.testing.assert_allclose(came.normal_height, 0.8 * came.passing_height, rtol=3e-6)
    radius = np.cbrt(0.75 / np.pi * came.volume)
    np.testing.assert_allclose(came.upper_edge - came.passing_height, radius)
    np.testing.assert_allclose(came.normal_upper_edge - came.normal_height, radius)


@pytest.mark.parametrize("residual", [0.0, 0.02, 0.2])
def test_heights_in_steps_are_the_exact_ones_rounded_up(residual):
    """Heights searched in steps, as for hazards and sitings, are those of the exact search rounded
    up."""
    came, heights = drawn(400), [0.5 * k for k in range(1, 60)]

    def is_enough(ead_class, k):
        return passes(came, heights[k], EAD_ENERGY[ead_class]).mean() <= residual

    found = least_heights(range(len(EAD_ENERGY)), heights, is_enough, None)
    rows = choices(came, residual)
    for choice, row in zip(found, rows, strict=True):
        assert np.isnan(choice.height) == np.isnan(row["height"])
        if not np.isnan(choice.height):
            assert choice.height == max(0.5, 0.5 * np.ceil(row["height"] / 0.5))
            assert choice.cost == EAD_ENERGY[choice.ead_class] / 1000 * choice.height
    priced = [choice.cost for choice in found if not np.isnan(choice.cost)]
    best = cheapest(found)
    assert (best.cost if best else None) == min(priced, default=None)
    assert sum(row["cheapest"] for row in rows) == bool(priced)


@pytest.mark.parametrize("residual", [0.0, 0.01, 0.05, 0.3])
def test_the_height_for_a_residual_is_the_least(residual):
    came = drawn(997)
    for capacity in EAD_ENERGY:
        height = height_for(came, capacity, residual)
        broken = (came.energy_total > capacity).mean()
        assert math.isnan(height) == (broken > residual)
        if height > 0:
            assert passes(came, height, capacity).mean() <= residual
            assert passes(came, np.nextafter(height, 0), capacity).mean() > residual


def test_what_passes_is_what_brute_force_counts():
    came = drawn(500)
    for row in choices(came, 0.1):
        held = [
            energy <= row["capacity"] and high <= row["height"]
            for energy, high in zip(came.energy_total, came.passing_height, strict=True)
        ]
        if not math.isnan(row["height"]):
            assert row["residual"] * came.n == pytest.approx(held.count(False))
            assert row["residual_low"] <= row["residual"] <= row["residual_high"]


def test_more_capacity_or_height_never_lets_more_pass():
    came = drawn(500)
    heights = np.linspace(0, 10, 21)
    left = np.array([[passes(came, h, e).mean() for h in heights] for e in EAD_ENERGY])
    assert (np.diff(left, axis=0) <= 0).all() and (np.diff(left, axis=1) <= 0).all()
    needed = [height_for(came, capacity, 0.05) for capacity in EAD_ENERGY]
    assert (np.diff([one for one in needed if one == one]) <= 0).all()


def test_a_barrier_of_the_sheet_lets_those_pass_that_it_says(result, tmp_path):
    came = crossings(result, 0)
    chosen = design(result, residual=0.02).choices
    best = chosen[chosen["cheapest"]].iloc[0]
    k, height = int(best["ead_class"]), float(best["height"])
    net = run(tmp_path, line=[], barrier=[LINE | {"height": height, "class": k}])
    crossed = ~np.isnan(at_lines(result)["line_speed"].values[0])
    outcome = at_lines(net)["barrier_outcome"].values[0]
    assert ((outcome > 0) == crossed).all()  # the barrier changes nothing above it
    assert ((outcome[crossed] > 1) == passes(came, height, EAD_ENERGY[k])).all()
    row = design(net).checks.iloc[0]
    assert row["residual"] == best["residual"] <= 0.02
    assert row["over"] + row["through"] == round(best["residual"] * came.n)


def test_checks_say_what_fails(result, tmp_path):
    low = LINE | {"name": "low", "height": 0.5, "class": 7}
    weak = LINE | {"name": "weak", "x": [0.0, 300.0], "y": [285.0, 285.0], "height": 90.0,
                   "class": 0}  # fmt: skip
    checks = design(run(tmp_path, barrier=[low, weak])).checks.set_index("line")
    assert list(checks.index) == ["low", "weak"]
    assert not checks.loc["low", "height_holds"] and checks.loc["low", "energy_holds"]
    assert checks.loc["weak", "height_holds"] and not checks.loc["weak", "energy_holds"]
    assert not checks["holds"].any()


def test_a_check_that_the_interval_straddles_is_undecided(result, tmp_path):
    """A height between the limits of the needed height is undecided; energy is checked
    separately."""
    asked = design(result).demand.iloc[0]
    low, value, high = (asked[f"height_needed{end}"] for end in ("_low", "", "_high"))
    assert low < value < high
    heights = 0.9 * low, (low + value) / 2, (value + high) / 2, 1.1 * high
    for height, holds, certain in zip(heights, "nnyy", "ynny", strict=True):
        net = run(tmp_path, line=[], barrier=[LINE | {"height": height, "class": 7}])
        row = design(net).checks.iloc[0]
        assert (row["height_holds"], row["height_certain"]) == (holds == "y", certain == "y")
        verdict = check_row(row.to_dict())[-1]
        said = {"ny": "no: height", "nn": "undecided: height", "yn": "undecided: height"}
        assert verdict.startswith(said.get(holds + certain, ("yes", "undecided: energy")))
        assert row["energy_certain"] == (asked["E_d_high"] < row["energy_allowed"])


def test_what_is_needed_is_never_shown_as_less(result):
    sheet = design(result, residual=0.02)
    asked, chosen = sheet.demand.iloc[0].to_dict(), sheet.choices.to_dict("records")
    rows = {row[0]: str(row[1]) for row in demand_rows(asked)}
    for title, name, factor in (
        ("height needed, vertical [m]", "height_needed", 1.0), ("E_d [kJ]", "E_d", 1e-3)
    ):  # fmt: skip
        value, low, *high = map(float, re.findall(r"[\d.]+", rows[title].replace(",", "")))
        assert factor * asked[name] <= value <= 1.01 * factor * asked[name]
        assert low < value and all(one >= factor * asked[f"{name}_high"] for one in high)
    came = crossings(result, 0)
    for row, cells in zip(chosen, choice_table(sheet, asked["line"]).rows, strict=True):
        if row["height"] == row["height"]:
            assert passes(came, float(cells[1]), row["capacity"]).mean() <= 0.02


@pytest.mark.parametrize(
    ("value", "plain", "up"),
    [(6.491, "6.49", "6.50"), (6.49, "6.49", "6.49"), (999.6, "1,000", "1,000"),
     (9.001, "9.00", "9.01"),
     (1234.0, "1,230", "1,240"), (0.1 + 0.2, "0.300", "0.300"),
     (math.nan, "-", "-"), (0, "0", "0")],
)  # fmt: skip
def test_rounding_up(value, plain, up):
    assert (number(value), number(value, up=True)) == (plain, up)


def test_windows_cover_the_line_and_are_blank_where_few_come(result):
    sheet = design(result, along="road", width=40.0, min_boulders=50)
    along = sheet.along
    assert along["start"].tolist() == [0, 40, 80, 120, 160, 200, 240, 280]
    assert along["end"].iloc[-1] == 300
    assert along["n"].sum() == sheet.demand["n"][0] == crossings(result, 0).n
    assert (along["E_d"].isna() == (along["n"] < 50)).all() and along["E_d"].notna().any()
    whole = design(result, along="road", width=1000.0).along
    assert whole["E_d"].tolist() == sheet.demand["E_d"].tolist()


def test_prices_decide_on_the_cheapest(tmp_path):
    came = equal()
    table = tmp_path / "costs.csv"
    table.write_text("class,height,cost\n2,2.5,1\n2,3.0,30\n3,4.0,20\n")
    rows = choices(came, 0.0, read_costs(table))
    assert [row["ead_class"] for row in rows if row["cheapest"]] == [3]
    assert rows[2]["cost"] == 30  # 2.5 m is too low
    neutral = choices(came, 0.0)
    assert [row["cost"] for row in neutral if row["cheapest"]] == [500 * 3.0]
    assert read_costs(Path(rockfall.__file__).parent / "data" / "design_costs_example.csv")


@pytest.mark.family(2)
@pytest.mark.parametrize(("language", "cost"), [
    ("en", "cost per metre"), ("de", "Kosten je Meter"), ("fr", "coût par mètre"),
    ("it", "costo al metro"),
])  # fmt: skip
def test_only_prices_are_called_a_cost(language, cost, result, tmp_path):
    table = tmp_path / "costs.csv"
    table.write_text("class,height,cost\n7,90,5\n")
    with speaking(language):
        priced = as_text(choice_table(design(result, costs=table), "road"))
        neutral = as_text(choice_table(design(result), "road"))
    assert cost in priced and "kJ m" not in priced
    assert "[kJ m]" in neutral and cost not in neutral


@pytest.mark.parametrize(("heights", "told", "no"), [
    ((4.0, 5.0), None, None), ((40.0, 50.0), "prices are for barriers up to 50 m high", None),
    ((4.0, 60.0), "prices are for barriers up to 60 m high", None),
    ((400.0, 500.0), None, "line 2: height = 400: must be a number >= 0 and <= 100"),
    ((4.0, 5000.0), None, "line 3: height = 5000: must be a number >= 0 and <= 100"),
])  # fmt: skip
def test_prices_of_heights_in_another_unit(result, heights, told, no, tmp_path):
    table = tmp_path / "costs.csv"
    low, high = heights
    table.write_text(f"class,height,cost\n3,{low:g},500\n4,{high:g},900\n")
    if no:
        with refused(f"{table}: {no}"):
            design(result, costs=table)
        return
    doubts = [text for text in design(result, costs=table).warnings if "prices" in text]
    assert len(doubts) == bool(told) and all(text.startswith(told) for text in doubts)


def test_a_design_says_which_boulders_its_numbers_are_of(result, tmp_path):
    sheet = design(result)
    own = "Values refer to the boulders of the case: volume = 'normal', volume_mean = 0.8, "
    assert len(sheet.population) == 1 and sheet.population[0].startswith(own)
    assert sheet.population[0] in design_text(sheet)
    scenario = [{"name": "a", "frequency": 0.2, "volume_mean": 2.0}]
    volumes = {"volume": "normal", "volume_mean": 0.8, "volume_std": 0.2}
    case = make_case(tmp_path, *sets(), terrain={}, boulder=volumes, line=[LINE],
                     release={"x": 150.0, "y": 380.0})  # fmt: skip
    case = case.replace(case={"boulders": 20}, scenario=scenario)
    other = design(rockfall.run(case, dem=rough(), transform=grid(rough())))
    assert other.population[0].startswith(own)
    assert "not of the scenarios" in other.population[1]
    assert other.population[1] in design_text(other)


def test_nobody_comes(tmp_path):
    line = LINE | {"y": [398.0, 398.0]}  # above the release
    sheet = design(run(tmp_path, line=[line]), along="road")
    assert sheet.demand["n"][0] == 0 and math.isnan(sheet.demand["E_d"][0])
    assert not sheet.choices["cheapest"].any() and sheet.along["E_d"].isna().all()
    high = sheet.demand["fraction_high"][0]  # Wilson's upper limit for zero
    assert high == pytest.approx(1.96**2 / (3 * BOULDERS + 1.96**2), rel=1e-3)
    assert sheet.demand["fraction"][0] == 0 == sheet.demand["fraction_low"][0]
    most = number(100 * high, up=True)
    text = f"road: 0 boulders arrive, but the interval of the fraction is 0 to {most} %"
    assert text in design_text(sheet)


def test_what_is_refused(result, tmp_path):
    with refused("along = 'rail': no such line (lines: road)"):
        design(result, along="rail")
    for residual in (-0.1, 1.0, math.nan):
        with refused(f"residual = {residual}: must be >= 0 and < 1"):
            design(result, residual=residual)
    with refused("standard = 'DIN': must be one of UNI, ONR"):
        design(result, standard="DIN")
    with refused("survey = 'fair': must be one of good, poor"):
        design(result, survey="fair")
    with refused("width = 0: must be > 0 m"):
        design(result, along="road", width=0)
    with refused("volume = -1.0: must be > 0 m3"):
        design(result, volume=-1.0)
    with refused("design: the result has no evaluation lines and no barriers"):
        design(run(tmp_path, line=[]))
    with refused("design: the result has no boulders"):
        design(result.isel(boulder=slice(0)))


@pytest.mark.parametrize(
    "change, message",
    [
        (("UNI,gamma_gamma,,1.00", "UNI,gamma_g,,1.00"), "UNI: has no factor gamma_gamma"),
        (("UNI,gamma_tr,literature", "UNI,gamma_tr,book"),
         "UNI: has no factor gamma_tr literature"),
        (("UNI,gamma_dp,good,1.02", "UNI,gamma_dp,good,-1"),
         "line 5: value = -1: must be a number >= 0"),
        (("standard,factor", "norm,factor"),
         "line 1: column norm: must be one of standard, factor, condition, value, source"),
    ],
)  # fmt: skip
def test_a_table_of_factors_that_is_wrong(change, message, tmp_path):
    table = tmp_path / "factors.csv"
    table.write_text(FACTORS.read_text().replace(*change))
    with refused(f"{table}: {message}"):
        read_factors(Conditions(survey="good"), table)


def test_the_command_prints_and_writes(file, tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    folder = tmp_path / "sheet"
    words = ["design", str(file), "--along", "road", "--factors", str(FACTORS)]
    assert main([*words, "-o", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "EAD 340059 class" in said and "Factors: quantile_speed 0.95, " in said
    names = ["along", "checks", "choices", "demand", "factors", "loads"]
    assert sorted(path.stem for path in folder.glob("*.csv")) == [f"design_{n}" for n in names]
    assert (folder / "design_along.png").stat().st_size > 10_000
    loads = pd.read_csv(folder / "design_loads.csv")
    assert loads["result"].unique().tolist() == [str(file)] and len(loads) == 7
    again = ["design", str(file), "--factors", str(folder / "design_factors.csv")]
    assert main([*again, "-o", str(folder), "--overwrite"]) == 0  # factors written by the command
    assert main(["design", str(file), str(file)]) == 2
    assert "is given twice" in capsys.readouterr().err
    (folder / "design_loads.csv").write_text("mine\n")
    assert main(["design", str(file), "-o", str(folder)]) == 2


def test_what_rests_on_unconfirmed_rebounds_is_never_said_to_hold(tmp_path):
    """A check that rests on grounds or forests without confirmation is never "yes", only "no" or
    undecided. Users confirm a ground of their own with `calibration` "back-analysed"."""
    head = "name,model,r_n,r_t,roughness_angle,min_hop,source\n"
    (tmp_path / "mine.csv").write_text(f"{head}mine,constant,0.5,0.95,4,1,fitted in 2024\n")
    size, stand = {"uniform_mean_radius": 0.02}, {
        "uniform_stems": 20.0, "uniform_dbh_mean": 20.0, "uniform_dbh_std": 1.0,
        "uniform_conifers": 60.0,
    }  # fmt: skip
    quoted = {"surface": size | {"ground": "soil_6"}}
    own = {"surface": size | {"ground": "mine", "ground_table": "mine.csv"}}
    nets = [LINE | {"name": "high", "height": 90.0, "class": 7},
            LINE | {"name": "low", "y": [250.0, 250.0], "height": 0.1, "class": 0}]  # fmt: skip
    found = {}
    for name, groups, calibration in (
        ("sets", {}, "literature"), ("quoted", quoted, "back-analysed"),
        ("own", own, "literature"), ("fitted", own, "back-analysed"),
        ("forest", {"forest": stand}, "back-analysed"),
    ):  # fmt: skip
        net = run(tmp_path, line=[], barrier=nets, **groups)
        sheet = design(net, calibration=calibration)
        high, low = (check_row(row)[-1] for row in sheet.checks.to_dict("records"))
        assert low.startswith("no") or low == "no boulder arrives"
        found[name] = high
        said = "unconfirmed" in high
        _, shown, *_ = [*demand_rows(sheet.demand.to_dict("records")[0])][-1]
        assert ("; unconfirmed: " in shown) == said
        assert ("Warning: " in design_text(sheet)) >= said
    assert found["sets"] == found["fitted"] == "yes"
    assert found["quoted"] == found["own"] == "undecided; unconfirmed: rebounds"
    assert found["forest"] == "undecided; unconfirmed: forest"
