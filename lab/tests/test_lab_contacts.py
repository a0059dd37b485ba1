# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets from measured contacts: same estimator, refused input, and reproduction of sets."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from made import refused
from programs import refuses
from rockfall.analysis.planes.plane_bounce import set_rebound
from rockfall.cli import main
from rockfall_lab.sets.contacts import (
    contacts_provenance,
    fit_contacts,
    read_contacts,
    tied,
)
from rockfall_lab.sets.fit import Impacts, ImpactSet, as_rebounds, fit_set
from rockfall_lab.summary import contacts_needed

MEAN = np.array([0.75, 0.0, 0.12, 0.15, -0.4, -0.1, 0.3, 0.0, 0.45])
SPEEDS = "vt_in", "vn_in", "w_in", "vt_out", "vn_out", "w_out"


def speeds(n, seed=1):
    """V_in and V_out in adjacent columns, (n, 6), from a known distribution with little scatter."""
    random = np.random.default_rng(seed)
    angle = np.radians(random.uniform(10, 60, n))
    v_in = np.stack([np.cos(angle), -np.sin(angle), random.uniform(-0.2, 0.8, n)], axis=1)
    v_in *= random.uniform(3, 20, n)[:, None]
    return np.hstack([v_in, set_rebound(MEAN, 0.05**2 * np.eye(9))(v_in, random)])


def contacts(n=80, **more):
    """Columns of a contact table."""
    return dict(zip(SPEEDS, speeds(n).T.tolist(), strict=True)) | more


def write(path, columns, separator=",", start=""):
    rows = [list(columns), *zip(*columns.values(), strict=True)]
    text = "\n".join(separator.join(map(str, row)) for row in rows) + "\n"
    Path(path).write_text(start + text, encoding="utf-8")
    return path


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder):
    return sorted((path.name, path.read_bytes()) for path in folder.iterdir())


def groups(means):
    """Lines with the means in a set file."""
    return [line for line in means.read_text().splitlines() if line.startswith("  mean = ")]


# ---- same estimator


def test_contacts_are_fitted_as_impacts_are(place):
    run = np.arange(80) // 4
    v = speeds(80)
    found = fit_contacts(read_contacts(write("c.csv", contacts(run=run))))
    known = fit_set(as_rebounds(Impacts(v[:, :3], v[:, 3:], 4 * run)))
    assert list(found) == [1, 2, 3, 4, 5]
    for one in found.values():
        assert np.array_equal(one.mean, known.mean) and one.lateral is None
        assert np.array_equal(one.covariance, known.covariance)
        assert np.array_equal(one.mean_error, known.mean_error)
    assert (abs(known.mean - MEAN) < 5 * known.mean_error).all()


def test_ratios_are_rounded_as_the_model_does(place):
    given = [0.3, 0.5, 1.49, 1.5, 2.49, 2.5, 4.49, 4.5, 5.5, 7.0]
    found = read_contacts(write("c.csv", contacts(10, ratio=given)))
    assert found.ratio.tolist() == [1, 1, 1, 2, 2, 3, 4, 5, 5, 5] and found.beyond == 2
    parts = found.by_ratio()
    assert {ratio: len(one.v_in) for ratio, one in parts.items()} == {1: 3, 2: 2, 3: 1, 4: 1, 5: 3}
    assert np.array_equal(parts[2].v_in, found.impacts.v_in[3:5])
    about = "\n".join(contacts_provenance(found))
    assert "2 contacts have R_b/R_m below 0.5 or above 5.5" in about


def test_contacts_that_share_a_run_or_a_point_hang_together():
    runs, points = list("aabbcdd"), list("vwxyyzq")
    assert tied(7, []).tolist() == list(range(7))
    assert tied(7, [runs]).tolist() == [0, 0, 2, 2, 4, 5, 5]
    assert tied(7, [runs, points]).tolist() == [0, 0, 2, 2, 2, 5, 5]
    assert tied(4, [list("abca"), list("xyxy")]).tolist() == [0, 0, 0, 0]


def test_a_contact_that_does_not_leave_the_ground_creeps(place):
    columns = contacts(3)
    columns["vn_out"][1] = 0
    found = read_contacts(write("c.csv", columns)).impacts
    assert found.v_out[1, 1] == 0.01 * np.hypot(*found.v_in[1, :2])


def test_contacts_needed_are_told_from_the_scatter():
    error = np.zeros(9)
    error[[0, 3, 4]] = 0.025, 0.05, 0.1
    one = ImpactSet(MEAN, np.eye(9), error, np.zeros((9, 9)), 80, 0.0)
    assert contacts_needed(one) == (
        "  contacts for a standard error of 0.05: about 20 for a1, 80 for a4, 320 for a5"
    )


# ---- ratios without measurements


def test_a_ratio_without_contacts_is_refused_or_has_the_nearest(place, capsys):
    ratio = np.repeat([2.0, 4.2], 80)
    write("c.csv", contacts(160, ratio=ratio))
    assert main(["lab", "fit", "c.csv", "-o", "s.nml"]) == 2
    said = "rockfall: c.csv: R_b/R_m = 1: no contacts; --nearest-ratio takes the set of 2\n"
    assert capsys.readouterr() == ("", said)
    assert not Path("s.nml").exists()
    assert main(["lab", "fit", "c.csv", "-o", "s.nml", "--nearest-ratio", "--quiet"]) == 0
    one, two, three, four, five = groups(Path("s.nml"))
    assert one == two != four == three == five  # of two equally near ratios, the larger
    text = Path("s.nml").read_text()
    for ratio, near in ((1, 2), (3, 4), (5, 4)):
        assert f"! R_b/R_m = {ratio}: no contacts: the set of {near}, the nearest\n" in text
    assert "! R_b/R_m = 4: 80 contacts in 80 groups; " in text


# ---- files


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Folder with contacts without ratios, and the sets made from them."""
    folder = tmp_path_factory.mktemp("measured")
    turn = np.linspace(-60, 60, 80)
    table = contacts(run=np.arange(80) // 5, lateral=turn, ground=["scree"] * 80)
    write(folder / "c.csv", table)
    assert main(["lab", "fit", str(folder / "c.csv"), "-o", str(folder / "s.nml"), "--quiet"]) == 0
    return folder


@pytest.fixture
def again(measured, place):
    for path in measured.iterdir():
        (place / path.name).write_bytes(path.read_bytes())
    return place


def test_a_set_says_what_it_is_from(measured):
    lines = (measured / "s.nml").read_text().splitlines()
    assert "! Measured contacts: c.csv" in lines and "! Ground: scree" in lines
    assert f"! Columns: {', '.join(SPEEDS)}, run, lateral, ground" in lines
    assert "! R_b/R_m was not measured: the sets of all five ratios are the same." in lines
    (about,) = (line for line in lines if line.startswith("! all ratios: "))
    assert about.startswith("! all ratios: 80 contacts in 16 groups; V ")
    assert len(set(groups(measured / "s.nml"))) == 1
    assert sum(line.startswith("  lateral = ") for line in lines) == 5


def test_the_summary_prints_each_set_once(again, capsys):
    before = files(again)
    assert main(["lab", "fit", "c.csv"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("all ratios: 80 contacts\n") and out.count("  mean ") == 1
    assert out.count("contacts for a standard error of 0.05: about ") == 1
    assert "lateral deviation below 22.5 degrees 37.5%, to 45 37.5%, above 25.0% (80 " in out
    assert files(again) == before


def test_what_was_not_measured_is_said(place):
    about = contacts_provenance(read_contacts(write("c.csv", contacts(5))))
    assert "Neither run nor point was told: contacts are taken as independent." in about
    assert "Lateral deviations were not measured: not for &impact turning = 'lab'." in about


def test_sets_are_made_again_from_the_contacts_beside_them(again, capsys):
    assert main(["lab", "remake", "s.nml"]) == 0
    out = capsys.readouterr().out
    assert out == "s.nml: made again from the measured contacts in c.csv, the same in every bit\n"
    text = Path("s.nml").read_text()
    Path("s.nml").write_text(text.replace("&impact_set ratio = 4", "&impact_set ratio = 4 "))
    assert main(["lab", "remake", "s.nml"]) == 1
    assert "s.nml: made again from the measured contacts in c.csv, it d" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (Path.unlink, "c.csv is not beside it"),
        (lambda path: path.write_text(path.read_text() + "\n"), "c.csv beside it is not what .*"),
    ],
)
def test_sets_are_not_made_again_from_other_contacts(again, capsys, spoil, message):
    spoil(Path("c.csv"))
    refuses(["lab", "remake", "s.nml"], f"s.nml: is from measured contacts: {message}", capsys)


# ---- invalid tables


def changed(column, value, row=3):
    """Return a function that changes a cell of a contact table, in line `row` + 2 of its file."""

    def change(table):
        table[column] = list(table[column])
        table[column][row] = value

    return change


def without(column):
    return lambda table: table.pop(column)


def by_point(table):
    table["point"] = np.arange(80) % 9


def without_scatter(table):
    v_in = speeds(80)[:, :3]
    table |= zip(SPEEDS[3:], (v_in @ MEAN.reshape(3, 3).T).T.tolist(), strict=True)


FIT = ["lab", "fit", "c.csv", "-o", "s.nml", "--quiet"]
SPIN = "a set needs the spin before and after: one that is assumed makes up a3 and a6 to a9"
HOSTILE = {
    "a missing column": (without("vn_in"), "line 1: column vn_in: is missing"),
    "no spin": (without("w_in"), f"line 1: column w_in: is missing: {SPIN}"),
    "a spin not measured": (changed("w_out", ""), f"line 5: w_out = : {SPIN}; leave the .* out"),
    "an empty cell": (changed("vt_out", ""), "line 5: vt_out = : must be a number >= -1000 .*"),
    "NaN": (changed("w_in", "NaN"), "line 5: w_in = NaN: must be a number .*"),
    "away before": (changed("vn_in", 2.5), "line 5: vn_in = 2.5: must be .* <= -0.001"),
    "too fast": (changed("vt_out", 1e4), "line 5: vt_out = 10000.0: must be .* <= 1000"),
    "a gain of energy": (changed("vt_out", 900),
        "line 5: V_t.2 .* is [0-9.e+]* of that before: no contact gains .*"),
    "a ratio that is none": (lambda table: table.update(ratio=[0] * 80),
        "line 2: ratio = 0: must be a number >= .*"),
    "a run without a name": (lambda table: table.update(run=["a", "", *"b" * 78]),
        "line 3: run = : must not be empty"),
    "two grounds": (lambda table: table.update(ground=["scree", *["turf"] * 79]),
        "line 3: ground = turf: a set file is of one ground, and the first contact's is scree"),
    "a ground that breaks the line": (
        lambda table: table.update(ground=['"scree\n&impact_set"'] * 80),
        "line 2: ground = scree &impact_set: must be printable text"),
    "few deviations": (lambda table: table.update(lateral=[*[5] * 29, *[""] * 51]),
        "all ratios: 29 lateral deviations: at least 30 are needed for quantiles"),
    "few groups": (by_point,
        "all ratios: 80 contacts that hang together by run or point in 9 groups: at .*"),
    "no scatter": (without_scatter, "all ratios: the outgoing velocities do not scatter .*"),
    "no spin at all": (lambda table: table.update(w_in=[0] * 80),
        "all ratios: the incident .* too much alike .*"),
    "spin unchanged after": (lambda table: table.update(w_out=[0] * 80),
        "all ratios: .* do not scatter .*"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_what_cannot_be_is_one_line_and_nothing_is_written(name, place, capfd):
    change, message = HOSTILE[name]
    table = contacts()
    change(table)
    write("c.csv", table)
    refuses(FIT, rf"c\.csv: {message}", capfd)


HEAD = ",".join(SPEEDS)
TABLES = {
    "one row": (HEAD + "\n5,-2,1,3,1,2\n", "all ratios: 1 impacts: at least 60 are needed .*"),
    "bytes": (b"\x89PNG\xff\xfe", r"is a picture \(PNG\), not a CSV table: save the table as CSV"),
}


@pytest.mark.parametrize("name", TABLES)
def test_what_is_no_table_is_one_line(name, place, capfd):
    content, message = TABLES[name]
    Path("c.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    refuses(FIT, rf"c\.csv: {message}", capfd)


def test_a_standard_error_above_the_deviation_is_no_set(place, monkeypatch):
    found = read_contacts(write("c.csv", contacts()))
    error = np.full(9, 0.01)
    error[3] = 0.6
    one = ImpactSet(MEAN, 0.25 * np.eye(9), error, np.zeros((9, 9)), 80, 0.0)
    monkeypatch.setattr("rockfall_lab.sets.contacts.fit_set", lambda impacts: one)
    with refused(
        "c.csv: all ratios: 80 contacts are too few: the standard error of a4, 0.6, is above its "
        "deviation, 0.5"
    ):
        fit_contacts(found)


def test_options_of_the_other_kind_are_refused(place, capsys):
    write("c.csv", contacts(5))
    assert main(["lab", "fit", "c.csv", "--state", "peak"]) == 2
    impacts = xr.Dataset({"speed": ("impact", [1.0])})
    impacts.to_netcdf("c.nc")
    assert main(["lab", "fit", "c.nc", "--nearest-ratio"]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "rockfall: --state peak: is for impacts of the laboratory (.nc)",
        "rockfall: --nearest-ratio: is for contacts, not for single impacts",
    ]
