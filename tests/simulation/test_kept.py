# SPDX-License-Identifier: BSD-3-Clause
"""`&output kept`: statistics without the rows of boulders are those from rows, and are
bit-identical for parts, threads, kills and rockfall-batch."""

from html import unescape

import netCDF4
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import rockfall
from programs import Killed, killed_after, make_prepared, same_results
from rockfall.analysis.line_statistics import numbers_of
from rockfall.analysis.precision.intervals import Sources
from rockfall.analysis.precision.samples import Counts, Values
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.html_report.page import ReportInputs, report
from rockfall.kernel_rules import SAMPLE_BINS, SAMPLE_COARSE, SAMPLE_EDGES
from rockfall.language import LANGUAGES, speaking
from rockfall.plots.figures import figures
from rockfall.result.crossings import at_lines
from rockfall.result.samples import kept_note, simulated
from rockfall.result.validate import check_values
from rockfall.scene.read import read_scene
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_scene
from rockfall.studies.run_until import run_until
from rockfall.tables.design import design_text
from rockfall.text.summary import summary
from same import same, same_numbers
from scenes import case_in, grid, rough

SOURCES = 60  # more than there are single parts
UNIT = 1e-3  # [m], [m/s], [rad/s]; energies 1 J, fractions 1e-6
Z = rough()


def run(case, **how):
    return rockfall.run(case, dem=Z, transform=grid(Z), **how)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    x = np.linspace(100.0, 200.0, SOURCES)
    release = {"x": x, "y": np.full(SOURCES, 380.0), "drop_height": 5.0}
    output = {"maps": ["passages"], "trajectories": 3}
    return case_in(tmp_path_factory.mktemp("kept"), case={"boulders": 50}, release=release,
                   impact={"ratio": "nearest"}, output=output)  # fmt: skip


@pytest.fixture(scope="module")
def full(case):
    return run(case)


@pytest.fixture(scope="module")
def counted(case):
    return run(case.replace(output={"kept": "none"}))


def test_statistics_are_those_of_the_rows(full, counted):
    of_rows, of_counts = map(rockfall.line_statistics, (full, counted))
    assert (of_rows[["line", "quantity", "n"]] == of_counts[["line", "quantity", "n"]]).all(
        axis=None
    )
    unit = np.where(of_rows["quantity"].str.startswith("energy"), 1.0, UNIT)
    for name in ("mean", "std", "max"):
        assert ((of_rows[name] - of_counts[name]).abs() <= unit).all(), name
    for name in (name for name in of_rows if name[0] == "q" and name[1:].isdigit()):
        apart = (of_rows[name] - of_counts[name]).abs()
        assert (apart <= unit + 0.005 * of_rows[name].abs()).all(), name
    for name in ("fraction", "mean", "std", "q50", "q95"):  # lengths of intervals
        lengths = [table[f"{name}_high"] - table[f"{name}_low"] for table in (of_rows, of_counts)]
        alike = of_rows["quantity"] != "position"  # this varies between sources within coarse bins
        assert np.allclose(*(one[alike] for one in lengths), rtol=0.02, atol=2 * UNIT), name
        assert (lengths[1] / lengths[0]).between(0.95, 1.2).all(), name
    levels = [rockfall.return_levels(one, [10, 100]) for one in (full, counted)]
    pd.testing.assert_frame_equal(*levels, rtol=1e-5, atol=1e-5)  # all in single precision


def test_counts_with_a_tail_are_values(unit=1000.0):
    """Statistics from bins and the 100 largest values agree with those of all 20,000 values, of
    both signs and from 40 sources."""
    random = np.random.default_rng(1)
    source = Sources.of(np.arange(20_000) % 40)
    values = random.normal(5.0 + source.number / 10, 4.0)
    whole = np.rint(values * unit).astype("i8")
    coarse = np.searchsorted(SAMPLE_EDGES, whole) - 1
    bins = np.bincount(coarse, minlength=SAMPLE_BINS)
    groups = np.zeros((40, SAMPLE_COARSE), "i8")
    np.add.at(groups, (source.number, coarse // (SAMPLE_BINS // SAMPLE_COARSE)), 1)
    sums = [divmod(sum(map(int, numbers)), 2**62) for numbers in (whole, whole**2)]
    words = np.array([[*sums[0], *sums[1], whole.max()]])
    tail = np.sort(values)[-100:]
    counts = Counts(bins, words, groups, np.full(40, 500), unit, tail, False)
    of_rows, of_counts = (numbers_of(one) for one in (Values(values, source), counts))
    for name, value in of_rows.items():
        assert np.isclose(of_counts[name], value, rtol=0.005, atol=2 / unit), name
    assert counts.between(0.999, 20_000.0) == Values(values, source).between(0.999, 20_000.0)
    assert np.array_equal(counts.largest(100), tail) and counts.largest(101).size == 100


def test_numbers_by_source_are_those_of_the_rows(full, counted):
    of_rows, of_counts = (rockfall.line_statistics(one, "source") for one in (full, counted))
    same = ["line", "source", "boulders", "quantity", "n"]
    assert (of_rows[same] == of_counts[same]).all(axis=None) and of_rows["source"].nunique() == 20
    speed = of_rows["quantity"] == "speed"
    for name in ("mean", "q95"):
        assert np.allclose(of_rows[name][speed], of_counts[name][speed], rtol=0.005, equal_nan=True)


def test_rows_kept_are_those_of_all_and_the_rest_of_the_result_is_the_same(case, full, counted):
    some = run(case.replace(output={"kept": 70}))
    kept = some["boulder"].values - 1
    assert kept.size == 70 and np.unique(full["source"].values[kept]).size == SOURCES
    of_lines = {name for name in full.variables if "crossing" in full[name].dims} | {"row_size"}
    same_numbers(full.isel(boulder=kept), some, [
        name for name in full.variables if name != "crs" and name not in of_lines
    ])  # fmt: skip
    xr.testing.assert_identical(at_lines(full.isel(boulder=kept)), at_lines(some))
    assert counted.sizes["boulder"] == 0 and simulated(counted) == SOURCES * 50
    for name in counted.variables:
        if "boulder" not in counted[name].dims and name not in of_lines:
            assert np.array_equal(counted[name].values, some[name].values), name
    assert np.array_equal(counted["sample_ended"], np.bincount(full["status"], minlength=8)[1:])
    many = run(case.replace(output={"kept": 10**6}))
    assert rockfall.line_statistics(many).equals(rockfall.line_statistics(full))


@pytest.mark.all
def test_neither_chunks_threads_nor_parts_change_a_bit(case):
    case = case.replace(output={"kept": 70})
    whole = run(case)
    same(run(case, chunk=370, threads=2), whole)
    parts = [run(case, shard=(k, 4), threads=2) for k in (3, 1, 4, 2)]
    same(rockfall.merge(parts), whole)


def killed(scene, output, monkeypatch, chunks):
    with monkeypatch.context() as patch:
        killed_after(patch, chunks)
        with pytest.raises(Killed):
            run_scene(scene, chunk=500, checkpoint=Checkpoint(output, 0.0))
    return Checkpoint(output, np.inf)


@pytest.mark.all
def test_a_run_that_is_killed_goes_on(tmp_path, monkeypatch, case):
    case = case.replace(output={"kept": 70})
    scene = read_scene(case, dem=Z, transform=grid(Z))
    state = killed(scene, tmp_path / "a.nc", monkeypatch, 3)
    assert 500 <= state.found() <= 1500
    same(run_scene(scene, checkpoint=state), run(case))


@pytest.mark.parametrize("name", ["boulder", "sample_part_last", "sample_group_part"])
def test_a_checkpoint_of_other_rows_or_groups_is_refused(tmp_path, monkeypatch, case, name):
    case = case.replace(output={"kept": 70})
    scene = read_scene(case, dem=Z, transform=grid(Z))
    state = killed(scene, tmp_path / "a.nc", monkeypatch, 2)
    with netCDF4.Dataset(state.path, "a") as file:
        values = file[name][...]
        values[-1] -= 1 if name != "sample_part_last" or len(values) > 1 else -1
        file[name][...] = values
    with pytest.raises(rockfall.RockfallError, match=f"is damaged: ({name}|source)"):
        run_scene(scene, checkpoint=state)


@pytest.mark.all
@pytest.mark.parametrize("kept", ["none", 33])
def test_the_standalone_program_gives_the_same_bits_and_goes_on_with_a_part(batch, tmp_path, kept):
    output = {"maps": ["passages"], "trajectories": 0, "kept": kept, "energy_balance": True}
    case = make_prepared(tmp_path, output=output)
    scene, whole = read_scene(case), rockfall.run(case)
    begun = Checkpoint(tmp_path / "ready/a.checkpoint.nc", 0.0)
    begun.path = tmp_path / "ready/b.part.checkpoint"
    with pytest.MonkeyPatch.context() as patch:
        killed_after(patch, 2)
        with pytest.raises(Killed):
            run_scene(scene, chunk=45, checkpoint=begun)
    assert 45 <= begun.found() <= 90
    for words in (("-o", "a.part"), ("-o", "b.part", "--resume")):
        done = batch("case.nml", *words, cwd=tmp_path / "ready")
        assert done.returncode == 0, done.stderr
        assert "boulders" in done.stdout
        same_results(rockfall.merge([tmp_path / "ready" / words[1]]), whole)


def test_sources_that_are_many_share_groups_and_intervals_are_no_shorter(tmp_path):
    """Many sources share groups, so that their intervals include differences within a group and are
    up to 1.6 times as wide."""
    x = np.linspace(100.0, 200.0, 1500)
    release = {"x": x, "y": np.full(x.size, 380.0), "drop_height": 5.0}
    case = case_in(tmp_path, case={"boulders": 2}, release=release, output={})
    full, counted = run(case), run(case.replace(output={"kept": "none"}))
    assert counted.sizes["sample_group"] < 1100
    of_rows, of_counts = (
        rockfall.line_statistics(one).set_index("quantity") for one in (full, counted)
    )
    half = [table["mean_high"] - table["mean_low"] for table in (of_rows, of_counts)]
    assert (half[1] / half[0]).between(0.9, 1.6).all()
    assert (of_rows["n"] == of_counts["n"]).all()


def test_until_finds_as_many_boulders_without_rows(tmp_path):
    case = case_in(tmp_path, release={"x": [150.0], "y": [380.0], "drop_height": 5.0}, output={})
    how = {"rules": "speed.mean@L<4%", "dem": Z, "transform": grid(Z)}
    full, counted = (run_until(case.replace(output={"kept": kept}), **how) for kept in ("all", 20))
    assert full.sizes["boulder"] == simulated(counted) >= 1000
    assert counted.attrs["until_met"] == 1 and counted.sizes["boulder"] == 20
    again = run(case.replace(case={"boulders": simulated(counted)}, output={"kept": 20}))
    same(counted, again.assign_attrs(counted.attrs))


@pytest.mark.all
def test_what_needs_rows_says_so_and_the_rest_works(counted, tmp_path):
    assert "3,000 boulders, rows of 0 kept" in summary(counted)
    page = report(ReportInputs(counted))
    assert "3,000" in page and "jump height" in page
    rockfall.write_result(counted, tmp_path / "a.nc")
    assert rockfall.line_statistics(rockfall.read_result(tmp_path / "a.nc")).equals(
        rockfall.line_statistics(counted)
    )
    rockfall.export(counted, tmp_path / "gis")
    for ask in (
        lambda: rockfall.line_profile(counted, "L"),
        lambda: rockfall.design(counted),
        lambda: rockfall.line_statistics(counted, "volume"),
    ):
        with pytest.raises(RockfallError, match="requires rows of"):
            ask()


NET = {"name": "net", "x": [0.0, 300.0], "y": [300.0, 300.0], "height": 3.0, "capacity": 500.0}


def kept_with_a_net(case):
    return run(case.replace(output={"kept": 60}, barrier=[NET]))


def test_a_summary_says_why_it_has_no_outcomes_of_barriers(case):
    result = run(case.replace(output={"kept": "none"}, barrier=[NET]))
    assert "barriers: outcomes require rows, but &output kept = 'none' keeps none" in summary(
        result
    )


@pytest.mark.all
def test_a_design_says_from_which_boulders_it_is(case, tmp_path, capsys, blank_figures):
    result, file = kept_with_a_net(case), tmp_path / "some.nc"
    note = "Based on the 60 of 3,000 boulders that were kept."
    assert kept_note(result) == rockfall.design(result).kept == note
    assert f"Warning: {note}" in design_text(rockfall.design(result))
    assert note in summary(result).split("  barrier ")[1]
    page = report(ReportInputs(result))
    assert page.count(f"{note}</") == 2  # at the sheet, and at the barrier outcomes
    assert kept_note(run(case)) == rockfall.design(run(case)).kept == ""
    openpyxl, docx = pytest.importorskip("openpyxl"), pytest.importorskip("docx")
    rockfall.write_result(result, file)
    for language in LANGUAGES:
        with speaking(language):
            said = kept_note(result)
            page = unescape(report(ReportInputs(result)))
        assert page.count(f"{said}</") == 2 and (said == note) == (language == "en"), language
        if language not in ("en", "de"):
            continue  # documents use the same texts as the page
        folder, words = tmp_path / language, ["--tables", "xlsx", "docx", "--language", language]
        assert main(["design", str(file), "-o", str(folder), *words]) == 0
        assert main(["export", str(file), str(folder / "export"), *words]) == 0
        for name in ("design", "export/tables"):
            document = docx.Document(folder / f"{name}.docx")
            assert any(said in each.text for each in document.paragraphs), (language, name)
            book = openpyxl.load_workbook(folder / f"{name}.xlsx")
            rows = book["provenance"].iter_rows(values_only=True)
            assert any(said in str(row[0]) for row in rows), (language, name)
    assert note in capsys.readouterr().out


@pytest.mark.all
@pytest.mark.parametrize("maps", [["passages"], pytest.param(None, marks=pytest.mark.all)])
def test_variants_of_other_rows_are_refused_in_one_line(case, tmp_path, capsys, maps):
    def result(kept):
        return run(case.replace(output={"kept": kept, "maps": maps}))

    for name, kept in (("all", "all"), ("none", "none"), ("some", 60)):
        rockfall.write_result(result(kept), tmp_path / f"{name}.nc")
    needs = "requires rows of boulders, but &output kept = 'none' keeps none"
    rows = "its number of kept boulders (60, not 3,000) differs: run variants with the same &output"
    for pair, message in (
        (("all", "none"), f"none: {needs}"),
        (("none", "some"), f"none: {needs}"),
        (("all", "some"), f"some: is not a variant of all: {rows} kept"),
    ):
        assert main(["compare", *(str(tmp_path / f"{name}.nc") for name in pair)]) == 2
        said = capsys.readouterr().err
        assert message in said and said.count("\n") == 1, pair
    assert main(["design", str(tmp_path / "none.nc"), str(tmp_path / "some.nc")]) == 2
    assert needs in capsys.readouterr().err


def test_a_page_of_variants_says_from_which_boulders_it_is(case, tmp_path, blank_figures):
    some = run(case.replace(output={"kept": 60}))
    page = tmp_path / "page.html"
    with pytest.warns(UserWarning, match="elevations were given as an array"):
        rockfall.report_variants({"a": some, "b": kept_with_a_net(case)}, page)
    assert "Based on the 60 of 3,000 boulders that were kept." in page.read_text()


@pytest.mark.all
def test_figures_that_need_rows_are_named_and_maps_are_of_all(
    case, counted, tmp_path, capsys, monkeypatch
):
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    monkeypatch.chdir(tmp_path)  # without the impact set of the case, which has a figure
    bare = case.replace(output={"kept": "none", "maps": None, "trajectories": 0})
    why = "require rows of boulders (&output kept), which the result does not have"
    rockfall.write_result(run(bare), tmp_path / "bare.nc")
    assert main(["figures", str(tmp_path / "bare.nc"), str(tmp_path / "no")]) == 2
    said = capsys.readouterr()
    assert "no figure can be drawn: run-outs, stops and line statistics" in said.err
    assert why in said.err and not said.out and not (tmp_path / "no").exists()
    rockfall.write_result(counted, tmp_path / "maps.nc")
    assert main(["figures", str(tmp_path / "maps.nc"), str(tmp_path / "maps")]) == 0
    said = capsys.readouterr()
    assert f"run-outs, stops and line statistics are not drawn: they {why}\n" in said.err
    assert (tmp_path / "maps" / "pass_frequency.png").exists()
    for result in (counted, run(case.replace(output={"kept": 60}))):
        (passages,) = (one for one in figures(result) if one.name == "pass_frequency")
        assert passages.caption.startswith("Fraction of 3,000 boulders that pass each cell")


@pytest.mark.parametrize("kept", ["some", "'10'", 0, -3, 1.5, 2**31, "'1 to 2147483647'"])
def test_other_words_and_numbers_are_refused(case, kept):
    with pytest.raises(RockfallError, match="&output kept = .*: must be one of: all, none, 1 to"):
        case.replace(output={"kept": kept})


def test_limits_of_cells_of_sampled_sources_need_rows(case):
    with pytest.raises(RockfallError, match="&output kept = 'none'?: must be 'all' for maps with"):
        case.replace(release={"sources": "sample"}, output={"kept": "none"})


@pytest.mark.parametrize(
    "name, place, value",
    [("block", -1, 2**40), ("count", (0, 0), -1), ("group_bin", 0, -1), ("ended", 0, -1),
     ("largest", (0, 0, 0), np.nan), ("sums", (0, 0, 0, 1), -1), ("group_part", 0, 99)],
)  # fmt: skip
def test_a_damaged_sample_is_refused(counted, name, place, value):
    damaged = counted.copy(deep=True)
    damaged[f"sample_{name}"].values[place] = value
    with pytest.raises(RockfallError, match=f"a.nc: is damaged: sample_{name}"):
        check_values(damaged, "a.nc")


def test_boulders_are_counted_where_there_are_no_lines(case, full):
    result = run(case.replace(output={"kept": "none"}, line=[]))
    assert simulated(result) == full.sizes["boulder"]
    assert result["rebounds"] == full["rebounds"]
    assert result["sample_ended"].sum() == full.sizes["boulder"]
