# SPDX-License-Identifier: BSD-3-Clause
"""Crossings of lines that rockfall-batch stores in a file during a run."""

import pytest

import rockfall
from programs import make_full_case, same_results
from rockfall.scene.prepare import prepare

BLOCK = 1_000_000  # number of crossings from which they are stored in the file
COUNT = 1000  # number of lines


@pytest.mark.all
def test_crossings_beyond_a_block_are_those_of_rockfall_and_are_added_up(batch, tmp_path):
    west, north = 600000.0, 5000000.0
    line = [
        {"name": f"{k}", "x": [west, west + 300.0], "y": [north - 25.0 - 250.0 * k / COUNT] * 2}
        for k in range(COUNT)
    ]
    case = make_full_case(
        tmp_path, case={"boulders": 450}, output={"maps": ["passages"]},
    ).replace(line=line)  # fmt: skip
    prepare(case, tmp_path / "ready")
    whole = rockfall.run(case)
    assert whole.sizes["crossing"] > 1.1 * BLOCK
    done = batch("case.nml", "-o", "a.part", cwd=tmp_path / "ready")
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (tmp_path / "ready").iterdir() if "crossings" in path.name] == []
    same_results(rockfall.merge([tmp_path / "ready/a.part"]), whole)
    said = [text for text in done.stdout.splitlines() if text.startswith("line ")]
    passed = [int(text.split(": ")[1].split(" boulders")[0].replace("no", "0")) for text in said]
    assert sum(passed) == whole.sizes["crossing"]
