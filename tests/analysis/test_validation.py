# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall validate`: a law is within the bounds of boulders that it made itself, and beyond those
of others; nothing is judged where chance may decide."""

import numpy as np
import pandas as pd
import pytest

import rockfall
from programs import make_full_case, refuses
from rockfall.analysis.observations import read_observed
from rockfall.analysis.validation import BEYOND, COLUMNS, UNDECIDED, WITHIN, validate
from rockfall.cli import main

OWN = "impact sets, method B"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return make_full_case(tmp_path_factory.mktemp("site"), case={"boulders": 150})


@pytest.fixture(scope="module")
def made(case, tmp_path_factory):
    """Boulders of the case by another seed: where they came to rest, and what passed a line."""
    result = rockfall.run(case.replace(case={"seed": 4711}))
    places = {f"{name}": result[f"stop_{name}"].values for name in "xy"}
    places |= {f"start_{name}": result[f"start_{name}"].values for name in "xy"}
    folder = tmp_path_factory.mktemp("observed")
    pd.DataFrame(places).to_csv(folder / "stops.csv", index=False)
    line = str(result["line"].values[0])
    speed = result["line_speed"].values[0]
    speed = speed[np.isfinite(speed)]
    rows = {"line": line, "quantity": "speed", "unit": "m/s", "value": speed}
    pd.DataFrame(rows).to_csv(folder / "speeds.csv", index=False)
    return folder, line, speed


def of(found, law, statistic, line=""):
    table = found.table.set_index(["law", "line", "statistic"])
    return table.loc[law, line, statistic]


def test_a_law_is_within_the_bounds_of_its_own_boulders(case, made):
    folder, line, speed = made
    seen = read_observed(folder / "stops.csv", folder / "speeds.csv")
    found = validate(case, seen, tables=["meadow"], seeds=3)
    assert list(found.table.columns) == COLUMNS
    assert len(set(found.seeds)) == 3 and case.case["seed"] not in found.seeds
    assert {OWN, "table meadow"} <= set(found.laws)
    for place in ("", line):
        assert of(found, OWN, "mean", place).verdict == WITHIN
        assert of(found, OWN, "std", place).verdict == WITHIN
        assert of(found, OWN, "p", place).simulated > 0.01
        assert (
            of(found, OWN, "wasserstein", place).simulated
            < of(found, "constant", "wasserstein", place).simulated
        )
    mean = of(found, OWN, "mean", line)
    assert mean.observed == pytest.approx(speed.mean())
    assert mean.observed_error == pytest.approx(speed.std() / np.sqrt(speed.size), rel=0.2)
    assert BEYOND in set(found.table.verdict)


def test_few_boulders_decide_little(case, made):
    folder, _, _ = made
    some = folder / "some.csv"
    pd.read_csv(folder / "stops.csv").iloc[:6].to_csv(some, index=False)
    found = validate(case, read_observed(some), tables=[], seeds=2)
    assert of(found, OWN, "std").verdict in (UNDECIDED, BEYOND)
    assert of(found, OWN, "mean").verdict == UNDECIDED


def test_printed_numbers_are_compared(case, made, tmp_path):
    _, line, speed = made
    text = f"line,quantity,unit,mean,std,n\n{line},speed,m/s,{speed.mean()},{speed.std()},100\n"
    (tmp_path / "printed.csv").write_text(text)
    found = validate(case, read_observed(tmp_path / "printed.csv"), tables=[], seeds=2)
    assert set(found.table.statistic) == {"mean", "std"}
    assert of(found, OWN, "mean", line).observed_error == pytest.approx(speed.std() / 10)


def test_the_command_writes_its_table(case, made, tmp_path, capsys):
    folder, _, _ = made
    command = ["validate", str(case.name), str(folder / "stops.csv"), "--table", "talus"]
    out = tmp_path / "validation.csv"
    assert main([*command, "--seeds", "2", "--quiet", "-o", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "run-out in plan [m]" in printed and "table talus" in printed
    assert list(pd.read_csv(out).columns) == COLUMNS
    assert main([*command, "--seeds", "2", "--quiet", "-o", str(out), "--overwrite"]) == 0
    assert main([*command, "--quiet", "-o", str(folder / "stops.csv"), "--overwrite"]) == 2


def test_what_cannot_be_compared_is_refused(case, made, tmp_path, capsys, monkeypatch):
    folder, _, _ = made
    monkeypatch.chdir(tmp_path)
    (tmp_path / "apart.csv").write_text("line,quantity,unit,value\nnowhere,speed,m/s,3\n")
    name, stops = case.name, folder / "stops.csv"
    refuses(["validate", name, "apart.csv"], ".*: nothing that was observed .*", capsys)
    refuses(["validate", name, stops, "--seeds", "1"], "--seeds 1: at least 2 .*", capsys)
    refuses(["validate", name, stops, "--table", "moon"], ".* no such table of impacts.*", capsys)
