# SPDX-License-Identifier: BSD-3-Clause
"""Progress in a log: one line every ten seconds, with the remaining time."""

import re

import pytest

import rockfall
from rockfall.cli import main
from rockfall.simulation import progress
from rockfall.simulation.progress import add_steps, progress_bar, step, stepped, working
from scenes import grid, make_case, rough, sets

LINE = re.compile(r"rockfall: ([\d,]+) of ([\d,]+) (\w+), ([\d,]+) s left")


@pytest.fixture
def clock(monkeypatch):
    """Time [s] that a test sets, in a list of one number."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    monkeypatch.delenv("ROCKFALL_PROGRESS", raising=False)
    return now


def test_a_line_comes_every_ten_seconds_with_the_time_left(clock, capsys):
    with progress_bar(10_000, True) as advance:
        for second in range(1, 41):
            clock[0] = second
            advance(250)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "rockfall: 2,500 of 10,000 boulders, 30 s left",
        "rockfall: 5,000 of 10,000 boulders, 20 s left",
        "rockfall: 7,500 of 10,000 boulders, 10 s left",
    ]


def test_short_work_and_what_is_not_shown_are_silent(clock, capsys):
    for shown, seconds in ((True, 9.9), (False, 1e3)):
        with working(shown):
            add_steps(2)
            clock[0] += seconds
            step()
    step()  # no work
    assert capsys.readouterr().err == ""


def test_progress_can_be_left_out(clock, capsys, monkeypatch):
    monkeypatch.setenv("ROCKFALL_PROGRESS", "none")
    with progress_bar(100, True) as advance:
        clock[0] = 60.0
        advance(10)
    assert capsys.readouterr().err == ""


def test_a_terminal_waits_before_it_shows_a_bar(clock, monkeypatch, capsys):
    monkeypatch.setattr(progress.sys.stderr, "isatty", lambda: True, raising=False)
    with progress_bar(4, True, "steps", patience=2.0) as advance:
        clock[0] = 1.0
        advance(1)
        assert "steps" not in capsys.readouterr().err
        clock[0] = 3.0
        advance(1)
    assert "2/4" in capsys.readouterr().err


@pytest.mark.all
@pytest.mark.parametrize(
    "words", ["lines out.nc", "export out.nc gis", "report out.nc", "design out.nc"]
)
def test_products_announce_the_steps_that_they_do(words, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    z = rough()
    line = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]},
            {"name": "M", "x": [0.0, 300.0], "y": [250.0, 250.0]}]  # fmt: skip
    case = make_case(tmp_path, *sets(), line=line, case={"boulders": 20}, terrain={},
                     release={"x": 150.0, "y": 380.0})  # fmt: skip
    monkeypatch.chdir(tmp_path)
    rockfall.write_result(rockfall.run(case, dem=z, transform=grid(z)), "out.nc")
    works = []

    class Work(progress._Work):
        def __init__(self, advance):
            super().__init__(advance)
            self.announced = 0
            works.append(self)

        def add(self, steps):
            self.announced += steps
            super().add(steps)

    monkeypatch.setattr(progress, "_Work", Work)
    assert main(words.split()) == 0
    (work,) = works
    assert 2 <= work.announced <= work.made <= work.announced + 4  # reading first pages of inputs


def test_stepped_items_are_those_that_are_given(clock):
    with working():
        add_steps(3)
        assert list(stepped("abc")) == ["a", "b", "c"]
