# SPDX-License-Identifier: BSD-3-Clause
"""Boulders thrown at rocks: reproducibility, properties of contacts, tables and sets made from
them, and refusals."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from made import refused
from programs import refuses
from rockfall.cli import main
from rockfall.grounds.impact_tables import FIELDS, open_table
from rockfall_lab import commands as cli
from rockfall_lab import remake
from rockfall_lab.case import LabCase, lab_case_of, read_lab_case
from rockfall_lab.contact_records import open_contacts
from rockfall_lab.sets.fit import ImpactSet
from rockfall_lab.spheres import sequences as module
from rockfall_lab.spheres.sequences import open_sequences, rebounds_of, run_sequences
from rockfall_lab.summary import sequences_summary
from rockfall_lab.tables import table_of

FLIES, ROLLS_ON, STOPS = range(3)
SMALL = LabCase(
    lab={"ratios": [1, 2], "seed": 5},
    material={"young": 2e8, "friction": 0.4, "rolling": 0.2, "boulder_rolling": 0.2},
    packing={"grading": 2, "depth": 2, "width": 3.5},
    impact={"step_factor": 2.8},
    throw={"throws": [16, 12], "on_layer": 4, "contacts": 6, "max_depth": 5},
)


@pytest.fixture(scope="module")
def data():
    return run_sequences(SMALL, threads=1)


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("r.nml").write_text(SMALL.text())
    return tmp_path


def numbers(data):
    return data.drop_attrs(deep=False)


# ---- reproducibility, however the case is run


def test_threads_and_chunks_change_no_bit(data, monkeypatch):
    monkeypatch.setattr(module, "THROWS_IN_CHUNK", 3)
    xr.testing.assert_identical(numbers(run_sequences(SMALL, threads=2)), numbers(data))


def test_more_throws_do_not_change_the_first(data):
    more = run_sequences(SMALL.replace(throw={"throws": [17, 13]}), threads=1)
    kept = more["sequence"].values <= np.where(more["ratio"].values == 1, 16, 12)
    xr.testing.assert_identical(numbers(more.isel(contact=kept)), numbers(data))


def test_an_interrupted_run_goes_on(place, data, monkeypatch):
    monkeypatch.setattr(module, "THROWS_IN_CHUNK", 3)
    throw, calls = module._throw, []

    def throw_some(*arguments):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return throw(*arguments)

    monkeypatch.setattr(module, "SAVE_SECONDS", -1.0)
    monkeypatch.setattr(module, "_throw", throw_some)
    with pytest.raises(KeyboardInterrupt):
        run_sequences(SMALL, threads=1, path="c.nc")
    assert 0 < open_sequences("c.nc").sizes["contact"] < data.sizes["contact"]
    monkeypatch.setattr(module, "_throw", throw)
    again = run_sequences(SMALL, threads=1, path="c.nc", resume=True)
    xr.testing.assert_identical(numbers(again), numbers(data))
    with refused("c.nc: is of another laboratory case: cannot resume"):
        run_sequences(SMALL.replace(lab={"seed": 6}), path="c.nc", resume=True)


def test_a_finished_run_goes_on_to_more_throws(place, data):
    run_sequences(SMALL.replace(throw={"throws": [4, 9]}), threads=1, path="c.nc")
    again = run_sequences(SMALL, threads=1, path="c.nc", resume=True)
    xr.testing.assert_identical(numbers(again), numbers(data))
    np.testing.assert_allclose(again.attrs["solid"], data.attrs["solid"])
    with refused("c.nc: has more throws than the case asks for: cannot resume"):
        run_sequences(SMALL.replace(throw={"throws": [4, 9]}), threads=1, path="c.nc", resume=True)


def test_a_file_has_all_that_makes_it_again(place, data):
    assert main(["lab", "impact", "r.nml", "-o", "c.nc", "--quiet"]) == 0
    kept = open_contacts("c.nc")
    xr.testing.assert_identical(numbers(kept), numbers(data))
    assert lab_case_of(kept.attrs["lab_case"], "c.nc") == SMALL


# ---- properties of contacts


def test_contacts_follow_one_another(data):
    entry, before, order = (data[name].values for name in ("entry", "exit", "order"))
    follows = order[1:] > 1
    assert (entry[order == 1] == 0).all()
    assert ((entry[1:] == 1) == (before[:-1] == ROLLS_ON))[follows].all()
    assert (before[:-1][follows] != STOPS).all(), "nothing moves on after a stop"
    assert (data["vn_out"].values[before == FLIES] > 0).all()
    assert (data["incidence"].values[entry == 0] > 0).all()


def test_level_ground_gives_nothing():
    flat = run_sequences(SMALL.replace(throw={"slope": [0, 0]}), threads=1)
    fall = np.maximum(0, -2 * 9.81 * 0.4 * flat["rise"]) / flat["speed"] ** 2
    assert float((flat["energy_out"] - fall).max()) <= 1


def test_relief_turns_boulders_aside(data):
    rough = run_sequences(SMALL.replace(throw={"relief": 15}), threads=1)
    turn = [
        np.abs(one["lateral"].values[(one["entry"] == 0) & (one["exit"] == FLIES)]).mean()
        for one in (data, rough)
    ]
    assert turn[1] > 1.2 * turn[0]


def test_each_ratio_can_have_a_relief_of_its_own(data):
    both = run_sequences(SMALL.replace(throw={"relief": [0, 15]}), threads=1)
    rough = run_sequences(SMALL.replace(throw={"relief": 15}), threads=1)
    for ratio, alike in ((1, data), (2, rough)):
        one, other = (found.isel(contact=found["ratio"].values == ratio) for found in (both, alike))
        xr.testing.assert_identical(numbers(one), numbers(other))


def test_throws_without_a_stable_step_are_reported(data):
    """Throws without contacts are the fastest, not a random sample, and need stiffer rocks."""
    assert "warning" not in sequences_summary(data)
    few = data.isel(contact=(data["ratio"].values == 1) | (data["sequence"].values > 2))
    assert (
        "warning: R_b/R_m = 2: no step was stable in 2 of 12 throws: they have no contacts"
        in sequences_summary(few)
    )


# ---- tables and sets


def test_a_table_of_several_ratios_is_made_again(place, capsys):
    case = SMALL.replace(throw={"throws": [32], "slope": [25, 45]}, lab={"title": "rocks"})
    Path("t.nml").write_text(case.text())
    assert main(["lab", "impact", "t.nml", "-o", "c.nc"]) == 0
    assert "R_b/R_m  solid  throws" in capsys.readouterr().out
    assert main(["lab", "table", "c.nc", "-o", "t.nc"]) == 0
    assert open_table(place / "t.nc").size.tolist() == [1, 2]
    capsys.readouterr()
    assert main(["lab", "remake", "t.nc", "--quiet"]) == 0
    assert "the same in every bit" in capsys.readouterr().out


def test_a_table_of_two_cases_is_made_again_of_both(place, capsys):
    case = SMALL.replace(lab={"ratios": [1]}, throw={"throws": [32], "slope": [25, 45]})
    Path("t.nml").write_text(case.text())
    soft = {"lab": {"ratios": [2]}, "material": {"young": 2e7}, "throw": {"adaptive": True}}
    Path("u.nml").write_text(case.replace(**soft).text())
    for name in "tu":
        assert main(["lab", "impact", f"{name}.nml", "-o", f"{name}c.nc", "--quiet"]) == 0
    assert open_sequences("uc.nc").attrs["unfinished"] == 0
    assert main(["lab", "table", "tc.nc", "uc.nc", "-o", "both.nc"]) == 0
    about = open_table(place / "both.nc").attrs
    assert "adaptive" not in about["lab_case"]
    assert "adaptive" in about["lab_case_2"]
    capsys.readouterr()
    assert main(["lab", "remake", "both.nc", "--quiet"]) == 0
    assert "the same in every bit" in capsys.readouterr().out


def test_a_ratio_with_few_contacts_has_few_bins_and_takes_none_from_the_others():
    case = SMALL.replace(throw={"throws": [70, 26], "slope": [25, 45]})
    data = run_sequences(case)
    both = table_of([data])
    alone = table_of([data.isel(contact=data["ratio"].values == 1)])
    assert both.bins == alone.bins
    n = int(np.prod(both.bins["flight"]) + np.prod(both.bins["roll"]))
    assert (both.record[: both.first[n]] == alone.record).all()
    assert len(both.first) == 2 * n + 1
    assert (np.diff(both.first) >= 1).all()


def test_contacts_from_flights_are_kept_from_more_throws():
    throw = {"throws": [150], "speed": [1, 2, 4], "slope": [5, 30]}
    data = run_sequences(SMALL.replace(lab={"ratios": [2]}, throw=throw))
    every, few = table_of([data]), table_of([data], 200)
    of_flights = [
        table.first[np.prod(table.bins["flight"])] / len(table.record) for table in (every, few)
    ]
    assert len(few.record) <= 200 + len(few.first)  # at least one record per bin
    assert 1.3 * of_flights[0] < of_flights[1] < 0.9


def column(table, name):
    return table.record[:, FIELDS.index(name)].astype(float)


def test_what_is_climbed_on_a_facet_becomes_motion_again():
    """A rolling contact ends at the mean ground, with its laboratory energy corrected for the
    height; a boulder too slow to climb out of a hole has none."""
    throw = {"throws": [60, 40], "slope": [25, 45]}
    level, rough = (
        run_sequences(SMALL.replace(throw=throw | {"relief": [relief]})) for relief in (0, 12)
    )
    assert np.abs(column(table_of([level]), "rise")).max() > 0.1
    table = table_of([rough])
    on = column(table, "exit") == ROLLS_ON
    assert not column(table, "rise")[on].any()
    assert column(table, "rise")[~on].any()

    unit2 = 9.81 * SMALL.throw["radius"]
    known = {name: rough[name].values.astype(float) for name in rough}
    slope, heading, lateral = (np.radians(known[k]) for k in ("slope", "heading", "lateral"))
    pulled = np.sqrt(unit2) * np.sin(slope) * known["duration"] / np.sqrt(0.4 / 9.81)
    along = known["vt_out"] * known["speed"] * np.cos(lateral) + pulled * np.cos(heading)
    across = known["vt_out"] * known["speed"] * np.sin(lateral) - pulled * np.sin(heading)
    motion = (along**2 + across**2 + 0.4 * (known["w_out"] * known["speed"]) ** 2) / unit2
    expected = np.maximum(0, motion + 2 * known["rise"])[known["exit"] == ROLLS_ON]
    found = sum(
        factor * column(table, name)[on] ** 2
        for name, factor in (("along_out", 1.0), ("across_out", 1.0), ("w_out", 0.4))
    )
    assert (expected == 0).any()
    assert len(found) > 0.9 * len(expected)  # except contacts that hardly move
    assert (np.abs(found - expected[:, None]).min(axis=0) <= 0.01 * found).all()


def least_squares(contacts, nearest=False):
    """Quick replacement for `fit_contacts`, which takes a minute."""
    v = contacts.impacts
    mean = np.linalg.lstsq(v.v_in, v.v_out, rcond=None)[0].T.ravel()
    found = ImpactSet(mean, 1e-3 * np.eye(9), np.zeros(9), np.zeros((9, 9)), len(v.v_in), 0.0)
    return dict.fromkeys(range(1, 6), found)


def test_a_set_is_made_of_the_same_contacts(place, capsys, monkeypatch):
    assert main(["lab", "impact", "r.nml", "-o", "c.nc", "--quiet"]) == 0
    words = ["lab", "fit", "c.nc"]
    refuses([*words, "-o", "s.nml"], "c.nc: R_b/R_m = 3: no contacts; .*", capsys)
    refuses([*words, "--state", "loss"], "--state loss: is for single impacts", capsys)
    for one in cli, remake:
        monkeypatch.setattr(one, "fit_contacts", least_squares)
    assert main([*words, "-o", "s.nml", "--nearest-ratio", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["lab", "remake", "s.nml", "--quiet"]) == 0
    assert "the same in every bit" in capsys.readouterr().out
    contacts = rebounds_of(open_sequences("c.nc"), "c.nc")
    assert set(contacts.by_ratio()) == {1, 2}


# ---- cases


def test_a_case_says_every_value_and_is_read_again(place):
    assert read_lab_case("r.nml") == SMALL
    for key in "layers", "mean_radius", "patience":
        assert not re.search(rf"\b{key}\b", SMALL.text()), "only single impacts have it"


def test_a_case_without_throws_has_no_group_of_them():
    case = LabCase()
    assert not case.throws
    assert "&throw" not in case.text()
    with refused("laboratory case: has no group &throw: it fires single impacts"):
        run_sequences(case)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("&throw throws=0 /", "&throw throws = 0: must be whole numbers, 1 to"),
        ("&throw throws=1.5 /", "must be whole numbers"),
        ("&throw throws=1,2 /", "must be one number, or one for each of &lab ratios"),
        ("&throw relief=1,2 /", "relief: must be one number, or one for each of &lab ratios"),
        ("&lab ratios=1,2 / &throw relief=1,40 /", "relief must be 0 (none) to 30 degrees"),
        ("&throw relief=40 /", "relief must be 0 (none) to 30 degrees"),
        ("&throw radius=0 /", "radius must be 0.01 to 10 m"),
        ("&throw max_depth=0 /", "max_depth: must be > 0"),
        ("&throw contacts=0 /", "contacts: must be 1 to 1000"),
        ("&throw adaptive=1 /", "&throw adaptive = 1: must be .true. or .false."),
        ("&throw on_layer=0 /", "on_layer: must be 1 to"),
        ("&throw slope=5, 60 /", "slope must be min and max, 0 to 45"),
        ("&throw speed=5, 3, 9 /", "must be min, median and max, in this order"),
        ("&throw trows=3 /", "&throw trows: unknown key"),
        ("&throw / &lab layers=3 /", "&lab layers = 3: is for single impacts: not together"),
        ("&throw / &packing mean_radius=0.2 /", "is for single impacts"),
        ("&throw / &impact speed=1,2,3 /", "is for single impacts"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(place, capsys, text, message):
    Path("bad.nml").write_text(text + "\n")
    refuses(["lab", "impact", "bad.nml"], f"bad.nml: .*{re.escape(message)}.*", capsys)


def test_another_file_is_not_taken_for_contacts_on_rocks(place):
    xr.Dataset({"speed": ("contact", [1.0])}).to_netcdf("other.nc")
    with refused("other.nc: is not a file of contacts of the laboratory"):
        open_sequences("other.nc")


# ---- angular rocks and boulders


ANGULAR = SMALL.replace(
    lab={"ratios": [2]}, packing={"clumps": True},
    throw={"throws": [3], "on_layer": 3, "shape": "platy"},
)  # fmt: skip


def test_angular_rocks_and_boulders_do_not_depend_on_threads_and_chunks(monkeypatch):
    whole = run_sequences(ANGULAR, threads=1)
    assert whole.attrs["shape"] == "platy"
    assert 0.45 < whole.attrs["inertia_factor"] < 0.6  # a plate of 1 : 0.8 : 0.42; a sphere has 0.4
    monkeypatch.setattr(module, "THROWS_IN_CHUNK", 1)
    xr.testing.assert_identical(numbers(run_sequences(ANGULAR, threads=2)), numbers(whole))


def test_a_platy_boulder_has_the_moment_of_a_plate():
    """The mean moment of inertia over m R_b^2 is that of a box, (a^2 + b^2 + c^2)/(18 R_b^2),
    within 5 %, because edges are rounded."""
    from rockfall_lab._lab import lab_f2py

    a, b, c = 1.0, 0.8, 0.42
    radius = (3 * a * b * c / (4 * np.pi)) ** (1 / 3)
    box = (a * a + b * b + c * c) / 18 / radius**2
    row = ANGULAR.row("boulder")
    assert lab_f2py.inertia_factor(row) == pytest.approx(box, rel=0.05)


def test_cases_of_spheres_keep_their_text():
    assert not re.search("clumps|shape|adaptive", SMALL.text())
    assert lab_case_of(ANGULAR.text(), "angular") == ANGULAR


@pytest.mark.parametrize(
    ("group", "values", "said"),
    [
        (
            "throw",
            {"shape": "round"},
            "&throw shape = 'round': must be one of sphere, compact, elongated, platy",
        ),
        ("packing", {"clumps": 3}, "&packing clumps = 3: must be .true. or .false."),
    ],
)
def test_what_shapes_cannot_be_is_refused(group, values, said):
    with refused(f"laboratory case: {said}"):
        SMALL.replace(**{group: values})
