# SPDX-License-Identifier: BSD-3-Clause
"""Open session: after any change, results are bit-identical to those of a new run; runs can be
cancelled."""

import os
import subprocess
import sys
import threading
import time
import warnings

import numpy as np
import pandas as pd
import pytest
from rasterio.crs import CRS

import rockfall
import scenes
from made import PLACE, every_third, make_layer, make_raster
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.result import variables
from rockfall.result.crossings import at_lines
from rockfall.scene import read, stages
from rockfall.simulation import batches, run_state
from same import same, same_bits

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

W, N = 600000.0, 5000000.0
LINE = {"name": "L", "x": [W, W + 300.0], "y": [N - 250.0] * 2}


def refused(start):
    return pytest.raises(rockfall.RockfallError, match=start)


NO_PLACE = dict.fromkeys(("x", "y", "steep_cells", "slope_threshold", "polygons", "points"))
NO_GROUND = dict.fromkeys(("uniform_mean_radius", "zones", "table", "ground"))
NO_FOREST = dict.fromkeys(("uniform_stems", "uniform_dbh_mean", "uniform_dbh_std", "trees"))
MAPS = ("passages", "energy_mean", "energy_max", "speed_q95", "jump_height_max_map", "deposits")


@pytest.fixture
def case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k, seed in ("", 1), ("2", 2):
        make_raster(f"dem{k}.tif", scenes.rough(seed=seed, dtype="f4"))
    make_raster("zones.tif", np.tile(np.repeat([1, 2], 30), (80, 1)).astype("i4"))
    (tmp_path / "zones.csv").write_text("zone,mean_radius\n1,0.3\n2,0.2\n")
    pd.DataFrame({
        "x": [W + 100, W + 200], "y": [N - 50] * 2, "volume_mean": [0.5, 1.5], "frequency": [1, 3],
    }).to_csv("points.csv", index=False)  # fmt: skip
    scenes.write_sets(tmp_path / "sets.nml", *scenes.sets(2.0), scenes.usual)
    scenes.write_sets(tmp_path / "softer.nml", *scenes.sets(1.0), scenes.usual)
    return rockfall.Case(
        folder=tmp_path,
        case={"boulders_total": 300, "seed": 7, "threads": 1},
        terrain={"dem": "dem.tif"},
        surface={"uniform_mean_radius": 0.25},
        impact={"sets": "sets.nml"},
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.2},
        release={"x": [W + 150.0], "y": [N - 40.0], "drop_height": 5.0},
        line=[LINE],
        output={"maps": list(MAPS), "rebounds": True, "trajectories": 5},
    )


def changes(rng):
    """Yield one change of each kind, with random values."""
    x, y = W + rng.uniform(60, 240), N - rng.uniform(30, 100)
    across = {"x": [W + 20.0, W + 280.0], "y": [N - rng.uniform(150, 300)] * 2}
    stems = {"uniform_stems": 300.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 8.0}
    yield {"release": NO_PLACE | {"x": [x, x + 9], "y": [y, y]}}
    yield {"release": NO_PLACE | {"steep_cells": True, "slope_threshold": rng.uniform(42, 46)}}
    yield {"release": NO_PLACE | {"points": "points.csv"}}
    yield {"line": [LINE, {"name": "M", **across}]}
    yield {"line": []}
    yield {"barrier": [{"name": "net", **across, "height": 3.0, "capacity": 1000.0}]}
    yield {"barrier": [], "boulder": {"density": rng.uniform(2500, 2900)}}
    yield {"dam": [{**across, "height": 6.0, "slope": 40.0, "allow_coarse": True}]}
    yield {"dam": []}
    yield {"boulder": {"volume_mean": rng.uniform(0.5, 1.5)}}
    yield {"surface": NO_GROUND | {"zones": "zones.tif", "table": "zones.csv"}}
    yield {"surface": NO_GROUND | {"uniform_mean_radius": 0.3, "ground": "meadow"}}
    yield {"surface": NO_GROUND | {"uniform_mean_radius": rng.uniform(0.2, 0.4)}}
    yield {"impact": {"sets": str(rng.choice(["sets.nml", "softer.nml"])), "ratio": "between"}}
    yield {"forest": stems | {"clear_of_sources": float(rng.choice([0.0, 20.0]))}}
    yield {"forest": NO_FOREST | {"clear_of_sources": None}}
    yield {"output": {"maps": ["sources", "reach_probability_by_source", *MAPS]}}
    yield {"output": {"maps": list(variables.MAP), "energy_balance": True}}
    yield {"output": {"maps": None, "kept": "none"}}
    yield {"output": {"maps": list(MAPS), "kept": 40, "map_extent": "terrain"}}
    yield {"output": {"maps": list(MAPS), "kept": None, "map_extent": None}}
    yield {"case": {"seed": int(rng.integers(1000))}}
    yield {"case": {"boulders": 7, "boulders_total": None}}
    yield {"case": {"boulders": None, "boulders_total": 200}}
    yield {"terrain": {"dem": str(rng.choice(["dem.tif", "dem2.tif"]))}}
    yield {"flight": {"gravity": rng.uniform(9.7, 9.9)}}


def last_of(session, *how, **more):
    *_, batch = session.run(*how, batch_seconds=0.002, **more)
    return batch


@pytest.mark.parametrize("seed", every_third(range(3)))
def test_a_session_gives_the_bits_of_fresh_runs_after_any_changes(case, seed):
    rng, compared = np.random.default_rng(seed), 0
    with rockfall.open(case) as session:
        for _ in range(6):
            several = rng.permutation([*changes(rng)])[: rng.integers(1, 4)]
            try:
                for change in several:
                    session.change(**change)
            except rockfall.RockfallError as error:  # a fresh run is then refused alike
                with pytest.raises(rockfall.RockfallError) as other:
                    rockfall.run(session.case.replace(**change))
                assert str(other.value) == str(error)
            batch = last_of(session)
            assert batch.complete
            same(batch.dataset(), rockfall.run(session.case))
            compared += 1
    assert compared == 6


@pytest.mark.parametrize("threads", [1, 3])
def test_boulders_of_a_run_are_those_of_a_total(case, threads):
    with rockfall.open(case, threads=threads) as session:
        for boulders in 50, 120, None:
            fresh = case if boulders is None else case.replace(case={"boulders_total": boulders})
            same(last_of(session, boulders).dataset(), rockfall.run(fresh))
        assert session.case == case
        session.change(release={"drop_height": 2.0})
        same(last_of(session).dataset(), rockfall.run(session.case))


@pytest.mark.parametrize(
    "maps", [pytest.param([*MAPS], marks=pytest.mark.all), ["sources", "passages"]]
)
def test_results_so_far_are_those_of_the_boulders_done(case, maps, monkeypatch):
    """Rows and crossings of a batch are bit-identical to those of the complete run, and its maps
    count its rows."""
    monkeypatch.setattr(batches.Batches, "_size", lambda _: 100)  # however fast the machine
    many = case.replace(case={"boulders_total": 600}, output={"maps": maps})
    complete = rockfall.run(many)
    with rockfall.open(many) as session:
        partial = [batch.dataset() for batch in session.run(batch_seconds=1e-9)]
    assert len(partial) > 2 and not partial[0].attrs["complete"]
    for one in partial:
        mine = complete.sel(boulder=one.boulder)
        for name in "stop_x", "status", "source":
            assert same_bits(one[name].values, mine[name].values), name
        for name, values in at_lines(one).items():
            assert same_bits(values.values, at_lines(mine)[name].values), name
        assert one["passages"].max() == one.sizes["boulder"]  # in the cell of the release
        assert int(one["rebounds"]) <= int(complete["rebounds"])
        assert set(one["trajectory_boulder"].values) <= set(one["boulder"].values)
    same(partial[-1], complete)


def test_boulders_so_far_come_from_all_sources(case):
    """The first boulders are evenly spread over all 20,000 numbers, and therefore over all
    sources."""
    steep = case.replace(
        case={"boulders_total": 20_000}, release=NO_PLACE | {"steep_cells": True},
        output={"maps": None, "rebounds": False, "trajectories": 0},
    )  # fmt: skip
    with rockfall.open(steep) as session:
        rows = next(iter(session.run(batch_seconds=1e-6))).dataset()
    assert rows.sizes["boulder"] < 200
    assert np.ptp(np.histogram(rows.boulder, 4, (1, 20_001))[0]) <= 1


def test_statistics_are_those_of_the_function(case):
    with rockfall.open(case) as session:
        batch = last_of(session)
    table = rockfall.line_statistics(rockfall.run(case))
    pd.testing.assert_frame_equal(batch.line_statistics(), table)
    chosen = batch.line_statistics(quantities=["energy_total", "passing_height"])
    pd.testing.assert_frame_equal(
        chosen, table.set_index("quantity").loc[chosen.quantity].reset_index()[table.columns]
    )
    with refused("quantities: unknown quantity 'weight': must be one of speed"):
        batch.line_statistics(quantities=["weight"])


def test_limits_of_the_model_are_those_of_the_result(case):
    ground = case.replace(surface={"ground": "constant_meadow"}, case={"boulders_total": 60})
    with rockfall.open(ground) as session:
        batch = last_of(session)
    result = rockfall.run(ground)
    remarks = [one.text for one in model_remarks(result, ground) if one.is_warning]
    assert batch.warnings == remarks and any("classical" in one for one in remarks)


def test_trajectories_of_a_batch_are_those_of_the_result(case):
    with rockfall.open(case.replace(output={"trajectories": 0})) as session:
        batch = last_of(session)
    recorded = rockfall.trajectories(rockfall.run(case))
    assert len(recorded) == 5
    for mine, its in zip(batch.trajectories(5), recorded, strict=True):
        assert mine.boulder == its.boulder
        for column, other in zip(mine[:-1], its[:-1], strict=True):
            assert same_bits(column, other)
        assert (np.diff(mine.time) >= 0).all()
    assert batch.trajectories(0) == [] and len(batch.trajectories(10**6)) == 300
    first, *others = (one.boulder for one in batch.trajectories(5))
    assert [one.boulder for one in batch.trajectories(5, skip={first, 999})] == others


def test_a_change_reads_only_what_depends_on_it(case, monkeypatch):
    case = case.replace(surface=NO_GROUND | {"zones": "zones.tif", "table": "zones.csv"})
    done = []
    for name in "read_dem", "read_rasters", "read_sources", "open_sets", "with_dams", "_digest":
        make = getattr(read, name)
        monkeypatch.setattr(
            read, name, lambda *of, _name=name, _make=make: done.append(_name) or _make(*of)
        )
    session = rockfall.open(case)
    assert done == ["read_dem", "with_dams", "read_rasters", "read_sources", "open_sets", "_digest"]

    def made(**change):
        done.clear()
        session.change(**change)
        return [*done]

    assert made() == []
    assert made(line=[], barrier=[]) == []
    assert made(release={"x": [W + 90.0]}) == ["read_sources"]
    assert made(boulder={"density": 2600.0}) == ["read_sources"]  # source layers may need it
    assert made(impact={"sets": "softer.nml"}) == ["read_rasters", "open_sets", "_digest"]
    assert made(output={"maps": None}) == []
    assert made(terrain={"dem": "dem2.tif"}) == [
        "read_dem", "with_dams", "read_rasters", "read_sources", "_digest",
    ]  # fmt: skip
    os.utime("zones.csv", (1.0, 1.0))
    assert "read_rasters" in made() and "read_dem" not in done
    (case.folder / "points.csv").write_text(f"x,y\n{W + 80},{N - 60}\n")
    assert made(release=NO_PLACE | {"points": "points.csv"}) == ["read_sources"]
    (case.folder / "points.csv").write_text(f"x,y\n{W + 88},{N - 61}\n{W + 99},{N - 61}\n")
    assert made() == ["read_sources"]
    same(last_of(session).dataset(), rockfall.run(session.case))


def test_a_stage_notes_what_it_looks_at(case):
    watched = stages.WatchedCase(case, reads=True)
    assert watched.boulder["density"] == 2800.0 and watched.lines and not watched.has_forest
    assert {*watched.seen} == {"boulder", "line", "barrier", "forest"}
    assert watched.text() == case.text() and {"dam", "ensemble", "case"} <= {*watched.seen}
    assert case.path("dem.tif") in watched.states


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"release": {"x": [W - 50.0]}}, "release"),
        ({"boulder": {"density": -1.0}}, "density"),
        ({"terrain": {"dem": "gone.tif"}}, "gone.tif"),
        ({"line": [LINE, LINE]}, "unique"),
        ({"dam": [{"x": [W, W + 9], "y": [N, N], "height": 5.0, "slope": 80.0}]}, "dam"),
        ({"weather": {"rain": 1.0}}, "weather"),
        ({"stems": np.ones((3, 3))}, "stems"),
        ({"case": {"threads": 10**6}}, "threads"),
    ],
)
def test_an_error_in_a_change_leaves_the_session_as_it_was(case, change, message):
    with rockfall.open(case) as session:
        before = last_of(session).dataset()
        with pytest.raises(rockfall.RockfallError, match=message):
            session.change(**change)
        assert session.case == case
        same(last_of(session).dataset(), before)
        session.change(release={"drop_height": 1.0})
        same(last_of(session).dataset(), rockfall.run(session.case))


def test_errors_of_a_run_are_said_at_once(case):
    with rockfall.open(case) as session:
        with refused("boulders = 0: must be at least 1"):
            session.run(0)
        with refused("batch_seconds = 0: must be > 0"):
            session.run(batch_seconds=0)
        with refused("until 'speed.mean@road<5%': unknown line 'road'"):
            session.run(until="speed.mean@road<5%")
    with refused("the session is closed"):
        session.run()
    with refused("the session is closed"):
        session.change(line=[])


def test_warnings_are_those_of_what_changed(case):
    with warnings.catch_warnings(record=True) as first:
        warnings.simplefilter("always")
        session = rockfall.open(case.replace(boulder={"density": 100.0}))
    assert ["density" in str(one.message) for one in first] == [True]
    assert first[0].filename == __file__
    with warnings.catch_warnings(record=True) as more:
        warnings.simplefilter("always")
        session.change(line=[{"name": "far", "x": [590000.0, 590009.0], "y": [5e6, 5e6]}])
    assert ["'far'" in str(one.message) for one in more] == [True]
    assert more[0].filename == __file__ and len(session.warnings) == 2
    session.change(boulder={"density": 2700.0}, line=[])
    assert session.warnings == []


def test_arrays_and_frames_may_be_given_and_changed(case):
    z, other = scenes.rough(), scenes.rough(seed=5)
    case = case.replace(terrain={"dem": "(array)"})
    with rockfall.open(case, dem=z, transform=PLACE) as session:
        same(last_of(session).dataset(), rockfall.run(case, dem=z, transform=PLACE))
        session.change(dem=other)
        fresh = rockfall.run(case, dem=other, transform=PLACE)
        same(last_of(session).dataset(), fresh)
        cells = np.zeros(z.shape, int)
        cells[10, 20:25] = 1
        place = NO_PLACE | {"cells": "(array)"}
        session.change(release=place, cells=cells)
        given = {"dem": other, "transform": PLACE, "cells": cells}
        same(last_of(session).dataset(), rockfall.run(session.case, **given))
        session.change(release={"x": [W + 150.0], "y": [N - 40.0], "cells": None}, cells=None)
        same(last_of(session).dataset(), fresh)


class Frame(pd.DataFrame):
    """The part of a GeoDataFrame that rockfall uses."""

    crs = CRS.from_user_input("EPSG:32632")

    @property
    def geometry(self):
        return pd.Series(list(self["geom"]), name="geom")


@pytest.mark.all
def test_frames_may_be_given_and_changed(case, monkeypatch):
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    roads = [
        Frame({"geom": [shapely.LineString([(W, y), (W + 300, y)])], "name": [name]})
        for name, y in (("upper", N - 150), ("lower", N - 300))
    ]
    with rockfall.open(case, lines=roads[0]) as session:
        same(last_of(session).dataset(), rockfall.run(case, lines=roads[0]))
        with refused("lines: the GeoDataFrame is empty"):
            session.change(lines=Frame({"geom": [], "name": []}))
        session.change(lines=roads[1], release={"drop_height": 3.0})
        fresh = rockfall.run(session.case, lines=roads[1])
        same(last_of(session).dataset(), fresh)
        monkeypatch.setattr("rockfall.scene.frames._write", None)  # not called again
        monkeypatch.setattr("rockfall.scene.lines.read_layer", None)
        session.change(release={"drop_height": 4.0})
        session.change(release={"drop_height": 3.0})
        same(last_of(session).dataset(), fresh)
        session.change(lines=None)
        same(last_of(session).dataset(), rockfall.run(session.case))


def test_a_run_may_be_left(case):
    with rockfall.open(case) as session:
        for batch in session.run(10**6, batch_seconds=0.002):
            assert batch.boulders < 10**6
            break
        same(last_of(session).dataset(), rockfall.run(case))


def test_a_layer_of_lines_is_read_once(case, monkeypatch):
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    across = shapely.LineString([(W, N - 200), (W + 300, N - 200)])
    make_layer("lines.gpkg", [across], name=["road"])
    case = case.replace(line=[{"file": "lines.gpkg"}])
    with rockfall.open(case) as session:
        assert last_of(session).line_statistics().line[0] == "road"
        monkeypatch.setattr("rockfall.scene.lines.read_layer", None)  # not called again
        session.change(release={"drop_height": 3.0})
        fresh = last_of(session).dataset()
    monkeypatch.undo()
    os.chdir(case.folder)
    same(fresh, rockfall.run(session.case))


def test_a_cancel_ends_a_run_and_the_session_goes_on(case):
    cancel, seen = threading.Event(), []
    with rockfall.open(case.replace(output={"trajectories": 0})) as session:
        for batch in session.run(10**6, cancel=cancel, batch_seconds=0.02):
            seen.append(batch.boulders)
            if len(seen) == 3:
                threading.Timer(0.01, cancel.set).start()
        assert 3 <= len(seen) and seen == sorted({*seen}) and seen[-1] < 10**6
        assert list(session.run(10**6, cancel=cancel)) == []  # immediately
        same(last_of(session).dataset(), rockfall.run(case.replace(output={"trajectories": 0})))


@pytest.mark.parametrize("tick", [1e-9, 1 / 64])  # [s] clock ticks; 1/64: Windows
@pytest.mark.parametrize("maps", [[], ["sources"]])
def test_pieces_of_a_run_are_short_where_boulders_are_slow(case, monkeypatch, maps, tick):
    """A run can be cancelled between pieces, which last 12 ms at the slowest recent rate. Boulders
    here take 0.5 ms, in the second half 2 ms: after the first piece none lasts more than 50 ms."""
    clock, times = [0.0], []

    def advance(run, scene, first, size, step=1):
        numbers = first + step * np.arange(size)
        times.append(np.where(numbers <= 2048, 0.0005, 0.002).sum())
        clock[0] += times[-1]
        return size, np.empty(0), np.empty((2, 0))

    class Clocks:
        perf_counter = staticmethod(lambda: clock[0])
        process_time = thread_time = staticmethod(lambda: clock[0] // tick * tick)

    with rockfall.open(case.replace(output={"maps": maps or None, "trajectories": 0})) as session:
        monkeypatch.setattr(run_state.Run, "advance", advance)
        monkeypatch.setattr(batches, "time", Clocks)
        seen = [batch.boulders for batch in session.run(4096)]
    assert seen[-1] == 4096 and seen == sorted({*seen})
    assert max(times[1:]) <= 0.05  # the time per boulder is unknown in the first piece
    assert np.mean(times) > 0.004


def test_a_run_goes_on_while_another_thread_changes_and_runs(case):
    slow = case.replace(case={"boulders_total": 3000})
    expected = rockfall.run(slow)
    with rockfall.open(slow) as session:
        running = session.run(batch_seconds=0.005)
        results, errors = [next(running)], []

        def change_and_run():
            try:
                for height in 1.0, 2.0, 3.0:
                    session.change(release={"drop_height": height})
                    one = last_of(session, 100)
                    fresh = session.case.replace(case={"boulders_total": 100})
                    same(one.dataset(), rockfall.run(fresh))
            except BaseException as error:
                errors.append(error)

        other = threading.Thread(target=change_and_run)
        other.start()
        results += running
        other.join()
        assert errors == []
        same(results[-1].dataset(), expected)
        first = results[0]
        assert first.line_statistics().n[0] <= first.boulders < 3000
        with refused("the run has continued since this batch and changed its maps: take the "
                     "dataset of a batch before the next batch"):  # fmt: skip
            first.dataset()


def test_batches_may_be_asked_by_another_thread_while_the_run_goes_on(case):
    with rockfall.open(case) as session:
        tables, end = [], threading.Event()
        latest = []

        def look():
            while not end.is_set():
                if latest:
                    tables.append(latest[-1].line_statistics(quantities=["speed"]))
                time.sleep(0.001)

        watcher = threading.Thread(target=look)
        watcher.start()
        for batch in session.run(3000, batch_seconds=0.005):
            latest.append(batch)
        end.set()
        watcher.join()
        assert tables
        for batch in latest[:3]:
            rows = batch.line_statistics(quantities=["speed"])
            assert 0 < rows.n[0] <= batch.boulders


def test_a_run_ends_when_its_rules_are_met(case):
    rules = "speed.mean@L<30%"
    with rockfall.open(case) as session:
        *_, last = session.run(200_000, until=rules, batch_seconds=0.01)
        assert last.until_met and not last.complete
        result = last.dataset()
    assert result.attrs["until"] == rules and result.attrs["until_met"] == 1
    assert result.sizes["boulder"] == last.boulders


def test_a_result_so_far_can_be_written_and_read(case, tmp_path):
    for kept in "all", 40:
        with rockfall.open(case.replace(output={"kept": kept})) as session:
            batch = next(iter(session.run(3000, batch_seconds=0.002)))
            result = batch.dataset()
        assert not batch.complete
        path = tmp_path / f"so_far_{kept}.nc"
        rockfall.write_result(result, path)
        read_again = rockfall.read_result(path)
        pd.testing.assert_frame_equal(
            rockfall.line_statistics(read_again), rockfall.line_statistics(result)
        )


def test_terrain_that_does_not_fit_is_refused(case, monkeypatch):
    monkeypatch.setattr("rockfall.session.session.machine_memory", lambda: 2000.0)
    with refused("needs more than half of the memory"):
        rockfall.open(case)


def test_the_package_loads_nothing_of_it_before_it_is_used():
    code = "import rockfall, sys; assert not any('session' in one for one in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
