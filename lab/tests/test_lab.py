# SPDX-License-Identifier: BSD-3-Clause
"""The laboratory from case to sets: reproducibility, resumption, physics, refusals, figures."""

import re
import signal
import sys
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import scenes
from made import refused
from programs import everything, refuses
from rockfall import RockfallError
from rockfall.cli import main
from rockfall.simulation.parts.lock import locked
from rockfall_lab import remake, summary
from rockfall_lab.case import LabCase, lab_case_of, names, read_lab_case
from rockfall_lab.sets.fit import fit_impacts, impacts_of
from rockfall_lab.sets.setfile import origin, provenance
from rockfall_lab.spheres import experiment
from rockfall_lab.spheres.experiment import (
    ENDED,
    STATES,
    STATUS,
    checksum,
    open_impacts,
    pack_layers,
    run_impacts,
)

VAUJANY = Path(__file__).parents[2] / "cases" / "vaujany"
ROWS = *names("outcome"), *names("outcome_counts")  # columns of an impact
GROUPS = "lab", "material", "packing", "impact"
SMALL = LabCase(
    lab={"layers": 3, "points": 2, "impacts": 3, "ratios": [1, 2, 1.5]},
    packing={"mean_radius": 0.1, "depth": 2, "grading": 2},
)
SHOTS = 18  # number of shots per ratio
FITTED = SMALL.replace(
    lab={"title": "Made by a test", "layers": 4, "impacts": 10, "ratios": [1, 2]},
    impact={"patience": 3},
)
MADE = FITTED.replace(lab={"layers": 8, "impacts": 5})


@pytest.fixture(scope="module")
def impacts():
    return run_impacts(SMALL)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Folder with impacts and the sets made from them by the commands."""
    folder = tmp_path_factory.mktemp("fitted")
    (folder / "lab.nml").write_text(FITTED.text())
    words = [str(folder / name) for name in ("lab.nml", "lab.nc", "sets.nml")]
    assert main(["lab", "impact", words[0], "-o", words[1], "--quiet"]) == 0
    assert main(["lab", "fit", words[1], "-o", words[2], "--quiet"]) == 0
    return folder


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Folder with a laboratory case, as the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("lab.nml").write_text(SMALL.text())
    return tmp_path


def files(folder):
    return sorted((path.name, path.read_bytes()) for path in folder.iterdir())


def same(one, other):
    return all(np.array_equal(one[name], other[name], equal_nan=True) for name in ROWS)


def made(mean, case=MADE):
    """Impacts of a case, all rebounded, with matrices about `mean` (9,)."""
    data = experiment._blank(case)
    shape = data["status"].shape
    random = np.random.default_rng(1)
    angle = np.radians(random.uniform(10, 60, shape))
    speed = random.uniform(5, 30, shape)
    v_in = speed[..., None] * np.stack(
        [np.cos(angle), -np.sin(angle), random.uniform(-0.5, 1, shape)], axis=-1
    )
    a = mean + 0.02 * random.normal(size=(*shape, 9))
    v_out = np.einsum("...ij,...j->...i", a.reshape(*shape, 3, 3), v_in)
    for k, name in enumerate(("vt", "vn", "w")):
        data[f"{name}_in"].values[:] = v_in[..., k]
        for state in STATES:
            data[f"{name}_{state}"].values[:] = v_out[..., k]
    for state in STATES:
        data[f"lateral_{state}"].values[:] = random.uniform(-1, 1, shape)
    data["status"].values[:] = STATUS["rebounded"]
    return data


# ---- reproducibility, however the case is run


@pytest.mark.parametrize(("threads", "shots"), [(2, 128), (1, 5)])
def test_threads_and_chunks_change_no_bit(impacts, monkeypatch, threads, shots):
    monkeypatch.setattr(experiment, "SHOTS_IN_CHUNK", shots)
    again = run_impacts(SMALL, threads=threads)
    assert checksum(again) == checksum(impacts)
    xr.testing.assert_identical(again.drop_attrs(deep=False), impacts.drop_attrs(deep=False))


@pytest.mark.parametrize("plan", [{"layers": 4}, {"points": 3, "impacts": 4}, {"ratios": [2]}])
def test_more_or_fewer_impacts_do_not_change_the_others(impacts, plan):
    other = run_impacts(SMALL.replace(lab=plan)).sel(ratio=2)
    first = other.isel(layer=slice(3), point=slice(2), impact=slice(3))
    assert same(first, impacts.sel(ratio=2))


def test_neighbouring_big_seeds_are_not_the_same():
    plan = {"layers": 1, "points": 1, "ratios": [1]}
    big = 2**53
    aims = [
        run_impacts(SMALL.replace(lab=plan | {"seed": seed}))["aim_x"] for seed in (big, big + 1)
    ]
    assert not np.array_equal(*aims)


def test_a_layer_is_the_same_alone_and_among_others():
    several, alone = pack_layers(SMALL, 2, count=3), pack_layers(SMALL, 2, first=2)
    for one, other in zip(several.one(1), alone.one(0), strict=True):
        assert np.array_equal(one, other)
    assert not np.array_equal(several.one(0)[2], several.one(1)[2])


def test_the_checksum_is_of_every_outcome(impacts):
    known = {checksum(impacts)}
    for name in ROWS:
        data = impacts.copy(deep=True)
        data[name].values[1, 2, 1, 2] += 1
        known.add(checksum(data))
    assert len(known) == 1 + len(ROWS)


# ---- Ctrl-C and resumption


def stops_after(questions):
    """Substitute for `interrupts` that reports no Ctrl-C for the first `questions` calls, then
    Ctrl-C."""

    @contextmanager
    def interrupts():
        asked = count()
        yield lambda: next(asked) >= questions

    return interrupts


@pytest.mark.parametrize("questions", [1, 9])
def test_resumed_impacts_are_those_of_an_uninterrupted_run(impacts, place, monkeypatch, questions):
    monkeypatch.setattr(experiment, "SHOTS_IN_CHUNK", 3)  # two chunks per layer
    fired = []
    fire = experiment._fire
    monkeypatch.setattr(experiment, "_fire", lambda *a: (fired.append(a[3:5]), fire(*a)))
    run = partial(run_impacts, SMALL, threads=1, path="out.nc", resume=True)
    with monkeypatch.context() as patch:
        patch.setattr(experiment, "interrupts", stops_after(questions))
        with pytest.raises(KeyboardInterrupt):
            run()
    status = open_impacts("out.nc")["status"].values
    # checked before each layer, and before each of its chunks
    assert (status > 0).sum() == 3 * len(fired) == {1: 0, 9: 18}[questions]
    data = run()
    assert checksum(data) == checksum(open_impacts("out.nc")) == checksum(impacts)
    assert np.array_equal(data["surface"], impacts["surface"])
    assert len(fired) == 18  # no shot is fired twice
    with monkeypatch.context() as patch:
        patch.setattr(experiment, "pack_layers", None)
        assert checksum(run()) == checksum(impacts)  # nothing is left to run


@pytest.mark.parametrize("change", ["seed", "version"])
def test_what_is_no_part_of_the_same_is_not_resumed(place, monkeypatch, change):
    with monkeypatch.context() as patch:
        patch.setattr(experiment, "interrupts", stops_after(2))
        with pytest.raises(KeyboardInterrupt):
            run_impacts(SMALL, path="out.nc")
    before = files(place)
    case, thing = SMALL.replace(lab={"seed": 2}), "laboratory case"
    if change == "version":
        case, thing = SMALL, "version of rockfall"
        monkeypatch.setattr(experiment, "__version__", "0.0.1")
    with refused(f"out.nc: is of another {thing}: cannot resume"):
        run_impacts(case, path="out.nc", resume=True)
    assert files(place) == before


def test_ctrl_c_twice_keeps_what_is_done_and_says_how_to_go_on(impacts, place, monkeypatch, capsys):
    monkeypatch.setattr(experiment, "SHOTS_IN_CHUNK", 3)
    # two signals count as one, however long the time between them
    monkeypatch.setattr("rockfall.interrupts.TOGETHER", np.inf)

    def pressing(name):
        does = getattr(experiment, name)

        def pressed(*arguments):
            signal.raise_signal(signal.SIGINT)
            return does(*arguments)

        return pressed

    words = ["lab", "impact", "lab.nml", "--threads", "1"]
    with monkeypatch.context() as patch:
        for name in ("_fire", "save_impacts"):
            patch.setattr(experiment, name, pressing(name))
        assert main(words) == 130
    assert capsys.readouterr() == ("", "rockfall: interrupted: lab.nc goes on with --resume\n")
    assert [path.name for path in sorted(place.iterdir())] == ["lab.nc", "lab.nml"]
    assert (open_impacts("lab.nc")["status"].values > 0).sum() == 3
    fired = []
    fire = experiment._fire
    monkeypatch.setattr(experiment, "_fire", lambda *a: (fired.append(a[3]), fire(*a)))
    assert main([*words, "--resume"]) == 0
    assert len(fired) == 18 - 1
    out, err = capsys.readouterr()
    assert err == "" and out.splitlines()[-1] == "lab.nc"
    assert checksum(open_impacts("lab.nc")) == checksum(impacts)
    before = everything(place)
    assert main([*words, "--resume"]) == 0
    told = "rockfall: lab.nc: already contains the finished run of this case: nothing was changed\n"
    assert capsys.readouterr() == ("", told) and everything(place) == before


def test_two_runs_of_a_laboratory_do_not_write_one_file(place, capsys):
    pytest.importorskip("fcntl", reason="its locks are those between processes")
    with locked(place / "lab.nc", print):
        assert main(["lab", "impact", "lab.nml", "-o", str(place / "lab.nc")]) == 2
    assert "another run is writing this output" in capsys.readouterr().err
    assert [path.name for path in place.iterdir()] == ["lab.nml"]


def test_impacts_that_are_not_all_done_make_no_sets(place, monkeypatch, capsys):
    monkeypatch.setattr(experiment, "interrupts", stops_after(2))
    assert main(["lab", "impact", "lab.nml", "--threads", "1"]) == 130
    capsys.readouterr()
    with refused("48 of 54 impacts are not done: no set yet"):
        provenance(open_impacts("lab.nc"), "peak")


# ---- physics through the interface


def test_incoming_velocities_are_those_drawn(impacts):
    angle = np.radians(impacts["angle"])
    for name, known in (
        ("vt_in", impacts["speed"] * np.cos(angle)),
        ("vn_in", -impacts["speed"] * np.sin(angle)),
        ("w_in", impacts["spin"] * impacts["speed"]),
    ):
        np.testing.assert_allclose(impacts[name], known, rtol=1e-14, atol=1e-14)


def test_draws_fill_their_ranges():
    given = {"speed": [7, 7.2, 8], "angle": [30, 32, 40], "spin": [-0.2, -0.15, -0.1]}
    plan = {"ratios": [1], "layers": 1, "points": 1, "impacts": 100}
    data = run_impacts(SMALL.replace(impact=given, lab=plan))
    for name, (low, median, high) in given.items():
        values = data[name].values
        assert low <= values.min() and values.max() <= high
        assert np.ptp(values) > 0.9 * (high - low)
        assert 35 <= (values < median).sum() <= 65
        assert np.unique(values).size == values.size


def test_a_point_has_one_aim_and_all_ratios_the_same_shots(impacts):
    first = impacts.isel(ratio=0)
    for name in ("aim_x", "aim_y", "heading_x", "heading_y", "speed", "angle", "spin"):
        assert (impacts[name] == first[name]).all()
    for name in ("aim_x", "heading_y"):
        values = first[name].values
        assert (values == values[..., :1]).all() and np.unique(values).size == 6
    np.testing.assert_allclose(impacts["heading_x"] ** 2 + impacts["heading_y"] ** 2, 1)


def test_no_energy_is_gained(impacts):
    """The kernel allows growth by 2 % of the incoming energy, plus the energy of the fall."""

    def energy(when):
        vt, vn, w = (impacts[f"{name}_{when}"] for name in ("vt", "vn", "w"))
        return (vt**2 + vn**2 + 0.4 * w**2) / 2

    ended = impacts["status"].isin([STATUS[name] for name in ENDED])
    assert ended.mean() > 0.9
    fall = impacts["top"] - impacts["surface"] + impacts["depth"]
    limit = 1.02 * energy("in") + SMALL.packing["gravity"] * fall
    for state in STATES:
        assert (energy(state) <= limit).where(ended, True).all()
    assert (energy("peak") > 0.01 * energy("in")).where(ended).mean() > 0.5


def test_outcomes_make_sense(impacts):
    status = impacts["status"]
    assert set(np.unique(status)) <= {STATUS[name] for name in summary.ENDS}
    done = impacts.where(status.isin([STATUS[name] for name in ENDED]))
    rebounded = status == STATUS["rebounded"]
    for state in STATES:
        assert (done[f"vn_{state}"].where(rebounded, 1) > 0).all()
        assert (abs(done[f"lateral_{state}"].fillna(0)) <= 1).all()
    assert (done["vn_peak"] >= done["vn_clear"]).where(rebounded, True).all()
    assert (done["depth"].fillna(0) <= impacts["top"]).all()
    assert (done["overlap"].fillna(0) >= 0).all() and (impacts["steps"] > 0).all()
    assert ((impacts["trouble"] > 0) == (status == STATUS["exploded"])).all()


ALIKE = {  # (lengths, speeds) multiplied by 16 or 4; rounding commutes with such factors
    "lengths x 16": (16, 4, {"mean_radius": 16}, {"young": 16}, {}),
    "densities x 4": (1, 1, {"density": 4}, {"young": 4}, {"density": 4}),
    "gravity x 4": (1, 2, {"gravity": 4}, {"young": 4}, {}),
}


@pytest.fixture(scope="module")
def stiff():
    """Case so stiff and slow that its time step is Rayleigh's, a product of powers of parameters;
    and its impacts."""
    case = SMALL.replace(
        lab={"layers": 1, "ratios": [1, 2]},
        packing={"friction": 0.3, "rigid_base": True},
        material={"young": 3e10, "damping": 0.1, "rolling": 0.2, "boulder_rolling": 0.1},
        impact={"speed": [2, 4, 8]},
    )
    return case, run_impacts(case)


@pytest.mark.parametrize("name", ALIKE)
def test_similar_impacts_are_similar_to_the_last_bit(stiff, name):
    """Equal Froude and Cauchy numbers give equal dimensionless results."""
    length, speed, *factors = ALIKE[name]
    case, plain = stiff
    groups = {"packing": case.packing, "material": case.material, "impact": case.impact}
    changed = {
        group: {key: factor * groups[group][key] for key, factor in some.items()}
        for group, some in zip(groups, factors, strict=True)
    }
    changed["impact"]["speed"] = [speed * one for one in case.impact["speed"]]
    data = run_impacts(case.replace(**changed))
    units = {"m": length, "m s-1": speed, "s": length / speed}
    for key, values in plain.items():
        factor = units.get(values.attrs.get("units"), 1)
        assert np.array_equal(data[key], factor * values), key


def test_layers_lie_in_their_box():
    layers = pack_layers(SMALL, 2, count=2)
    for k in range(len(layers)):
        x, radius, facts = layers.one(k)
        fact = dict(zip(names("layer"), facts, strict=True))
        width = fact["width"]
        assert width == pytest.approx(1.0)
        assert len(x) == len(radius) == layers.bodies[k]
        assert (x >= 0).all() and (x[:, :2] <= width).all()
        assert fact["top"] == (x[:, 2] + radius).max() > fact["surface"] > 0
        volume = 4 / 3 * np.pi * (radius**3).sum()
        assert fact["solid"] * width**2 * fact["surface"] == pytest.approx(volume)
        assert fact["floor_share"] == pytest.approx(1, abs=0.1)
        assert radius.max() / radius.min() <= 2


def test_what_explodes_is_counted():
    coarse = SMALL.replace(lab={"ratios": [1], "layers": 1})
    coarse = run_impacts(coarse.replace(impact={"step_factor": 300, "retries": 0}))
    assert (coarse["status"] == STATUS["exploded"]).all() and (coarse["trouble"] > 0).all()
    assert summary.impact_summary(coarse).split()[-10:-4] == ["6", "0", "0", "0", "6", "0"]


# ---- case


def other_value(value):
    """Another allowed value of a key."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, str):
        return 'it\'s & "so" / ! a title, long enough for more than one line of a namelist file'
    if isinstance(value, list):
        return [0.9 * one for one in value]
    return 0.9 * value or 0.1


def test_every_key_goes_through_the_text_of_a_case(tmp_path):
    plain = LabCase(packing={"grading": 2})
    values = {
        group: {key: other_value(value) for key, value in getattr(plain, group).items()}
        for group in GROUPS
    }
    case = LabCase(**values)
    for group in GROUPS:
        assert getattr(case, group) == values[group]
    assert lab_case_of(case.text(), "text") == case != plain
    (tmp_path / "lab.nml").write_text(case.text(), encoding="utf-8-sig")
    assert read_lab_case(tmp_path / "lab.nml") == case
    for group in GROUPS:  # a single key; the others have defaults
        for key, value in values[group].items():
            one = plain.replace(**{group: {key: value}})
            assert one != plain and lab_case_of(one.text(), "text") == one


def test_the_kernel_gets_what_the_case_says():
    case = SMALL.replace(packing={"rigid_base": True, "depth": 5}, impact={"wait": 3})
    rows = {
        kind: dict(zip(names(kind), case.row(kind, 4.0), strict=True))
        for kind in ("material", "packing", "shot", "range")
    }
    assert rows["material"] == case.material
    assert rows["packing"] == case.packing | {"ratio": 4} and rows["packing"]["rigid_base"] == 1
    assert (
        rows["shot"]["radius"] == 0.4
        and rows["shot"]["wait"] == 3
        and rows["shot"]["gravity"] == 9.81
    )
    assert rows["range"] == {
        "speed_min": 2, "speed_median": 10, "speed_max": 25, "angle_min": 3, "angle_median": 20,
        "angle_max": 60, "spin_min": -0.5, "spin_median": 0.25, "spin_max": 1,
    }  # fmt: skip


MALFORMED = {
    "unknown group": ("&lob seed = 2 /", "line 1: &lob: unknown group \\(similar groups: &lab, .*"),
    "unknown key": ("&lab sead = 2 /", "line 1: &lab sead: unknown key \\(similar keys: seed, .*"),
    "group given twice": ("&lab seed = 2 / &lab points = 4 /", "line 1: &lab: stands more than.*"),
    "key given twice": ("&lab seed = 2, seed = 3 /", "line 1: &lab seed: is given twice .*"),
    "group left open": ("&lab seed = 2", "line 1: &lab is not closed by /"),
    "quote left open": ("&lab title = 'A /", "line 1: closing quote is missing: 'A /"),
    "key without a value": ("&lab seed = /", "line 1: 'seed' has no value"),
    "text for a number": ("&packing depth = 'deep' /", "&packing depth = 'deep': must be a real.*"),
    "number for a text": ("&lab title = 3 /", "&lab title = 3: must be text in quotes"),
    "real for an integer": ("&lab points = 2.5 /", "&lab points = 2.5: must be an integer"),
    "NaN": ("&packing depth = NaN /", "&packing depth = NaN: must be a finite real number"),
    "no points": ("&lab points = 0 /", "&lab points = 0: must be 1 to 1000000"),
    "seed of 65 bits": (f"&lab seed = {2**63} /", f"&lab seed = {2**63}: must be a 64-bit.*"),
    "ratio twice": ("&lab ratios = 1, 2, 1 /", "&lab ratios .* = 1: must be > 0, each once"),
    "angle reversed": ("&impact angle = 90, 10, 5 /", "&impact angle = .*: must be min, .*"),
    "angle from below": ("&impact angle = -5, 10, 90 /", "impact: angle must be 1 to 90 .*"),
    "negative young": ("&material young = -1.0 /", r"material: young must be > 0 \[Pa\]"),
    "damping beyond the step": ("&material damping = 1.5 /", "material: damping must be 0 to 1"),
    "layer too narrow": ("&packing width = 2.0 /", "packing: width must .*"),
    "key that is set elsewhere": (
        "&impact radius = 1 /",
        "line 1: &impact radius: unknown key .*",
    ),
    "bytes": (b"\x89PNG\r\n\x1a\n\xff\xfe", r"is not text \(UTF-8\)"),
    "missing": (None, "cannot be read: No such file or directory"),
    "more impacts than memory": ("&lab points = 1000000, impacts = 1000000 /",
        "250000000000000 impacts do not fit in memory"),
}  # fmt: skip


@pytest.mark.parametrize("name", MALFORMED)
def test_a_bad_case_is_one_line_and_nothing_is_written(name, place, monkeypatch, capfd):
    monkeypatch.setattr(experiment, "_chunks", None)  # must not be called
    content, message = MALFORMED[name]
    if content is None:
        Path("lab.nml").unlink()
    else:
        Path("lab.nml").write_bytes(content if isinstance(content, bytes) else content.encode())
    refuses(["lab", "impact", "lab.nml", "-o", "out.nc"], f"lab.nml: {message}", capfd)


def test_an_empty_case_is_that_of_the_defaults():
    assert lab_case_of("! nothing & it's all / right\n", "text") == LabCase()
    assert lab_case_of("&LAB Seed=1 /\n&packing / ! twice '", "text") == LabCase()


# ---- from impacts to sets


def test_impacts_that_roll_on_enter_a_fit_and_what_went_wrong_does_not():
    data = made(scenes.LIVELY_MEAN)
    for k, name in enumerate(list(STATUS)[1:]):
        data["status"].values[..., k] = STATUS[name]
    found = impacts_of(data, 2)
    kept = [list(STATUS).index(name) - 1 for name in ENDED]
    assert np.array_equal(found.group, np.repeat(np.arange(8), 6))
    for k, name in enumerate(("vt", "vn", "w")):
        for values, when in ((found.v_in, "in"), (found.v_out, "peak")):
            known = data[f"{name}_{when}"].sel(ratio=2).values[..., kept]
            assert np.array_equal(values[:, k], known.ravel())


@pytest.mark.parametrize("name", ["exploded", "not_done"])
def test_numbers_that_mean_nothing_change_no_set(name):
    data = made(scenes.LIVELY_MEAN)
    data["status"].values[..., 3] = STATUS[name]
    plain = fit_impacts(data)
    for v in ("vt_peak", "vn_peak", "w_peak"):
        data[v].values[..., 3] = np.nan
    for ratio, found in fit_impacts(data).items():
        assert np.array_equal(found.mean, plain[ratio].mean)
        assert np.array_equal(found.covariance, plain[ratio].covariance)
        assert abs(found.mean - scenes.LIVELY_MEAN).max() < 0.1


def test_a_fit_is_of_one_of_three_states():
    data = made(scenes.LIVELY_MEAN)
    data["vt_loss"].values[:] *= 0.5
    assert fit_impacts(data, "loss")[1].mean[0] < fit_impacts(data, "clear")[1].mean[0] - 0.2
    with refused("state 'late': must be one of peak, loss, clear"):
        fit_impacts(data, "late")


@pytest.mark.parametrize("ratio", [0.5, 2.5, 6.0])
def test_only_whole_ratios_up_to_five_make_sets(ratio):
    data = made(scenes.LIVELY_MEAN, FITTED.replace(lab={"ratios": [ratio]}))
    with refused(f"R_b/R_m = {ratio:g}: a set has a ratio of 1, 2, 3, 4 or 5"):
        fit_impacts(data)


def test_a_set_file_says_where_it_comes_from_and_what_it_is(fitted):
    lines = (fitted / "sets.nml").read_text().splitlines()
    data = open_impacts(fitted / "lab.nc")
    assert lines[0] == "! Made by a test" and origin(fitted / "sets.nml") == (FITTED, "peak")
    assert f"! SHA-256 of the outcomes: {checksum(data)}" in lines
    status = data["status"].sel(ratio=2)
    rolled, exploded = (int((status == STATUS[name]).sum()) for name in ("rolled_on", "exploded"))
    (line,) = (line for line in lines if line.startswith("! R_b/R_m = 2: 80 impacts, "))
    assert f" {rolled} rolled_on, {exploded} exploded, " in line
    for found in fit_impacts(data).values():
        assert "  mean = " + ", ".join(f"{value:.12g}" for value in found.mean) in lines


def test_sets_made_again_are_the_same_or_the_line_is_named(fitted, place, monkeypatch, capsys):
    text = (fitted / "sets.nml").read_text()
    Path("same.nml").write_text(text)
    lines = text.splitlines()
    k = next(k for k, line in enumerate(lines) if line.startswith("  mean = "))
    lines[k] = lines[k][:-1] + str((int(lines[k][-1]) + 1) % 10)
    Path("changed.nml").write_text("\n".join(lines) + "\n")
    data = open_impacts(fitted / "lab.nc")
    monkeypatch.setattr(remake, "run_impacts", lambda case, **_: data)  # reproducible: see above
    before = files(place)
    assert main(["lab", "remake", "same.nml", "changed.nml", "--quiet"]) == 1
    out, err = capsys.readouterr()
    assert out == "same.nml: made again, the same in every bit\n"
    said = f"rockfall: changed.nml: made again, it differs: line {k + 1}: '  mean = "
    assert err.startswith(said) and err.count("\n") == 1
    assert files(place) == before


# ---- figures


@pytest.fixture
def quiet_figures():
    pytest.importorskip("matplotlib", reason="the report extra is not installed").use("Agg")


def test_layers_are_listed_and_drawn(quiet_figures, place, capsys):
    assert main(["lab", "pack", "lab.nml", "--ratio", "2", "--layers", "2", "-o", "layer.png"]) == 0
    lines = capsys.readouterr().out.splitlines()
    layers = pack_layers(SMALL, 2, count=2)
    rows = np.array([line.split() for line in lines[1:3]], float)
    assert np.array_equal(rows[:, 0], [1, 2]) and np.array_equal(rows[:, 1], layers.bodies)
    np.testing.assert_allclose(rows[:, 2:], (layers.facts[[0, 2, 3]].T / [0.1, 1, 1]), atol=5e-3)
    assert lines[3:] == ["layer.png"]
    assert [path.name for path in sorted(place.iterdir())] == ["lab.nml", "layer.png"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("layer", "cannot be written: .*"),
        ("lab.nml", "is an input; not overwritten"),
    ],
)
def test_a_picture_that_cannot_be_is_one_line(quiet_figures, place, capsys, name, message):
    before = files(place)
    assert main(["lab", "pack", "lab.nml", "--ratio", "1", "--layers", "1", "-o", name]) == 2
    assert re.fullmatch(f"rockfall: {name}: {message}\n", capsys.readouterr().err)
    assert files(place) == before


# ---- missing files, invalid arguments


def other_netcdf(path, _):
    xr.Dataset({"speed": ("point", [1.0])}).to_netcdf(path)


def cut(path, impacts):
    experiment.save_impacts(impacts, path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def damaged(path, impacts):
    """Write a complete file, with damaged values of one variable."""
    experiment.save_impacts(impacts, path)
    content = bytearray(path.read_bytes())
    at = content.index(b"\x78\x01", 4000)  # start of a compressed block
    content[at : at + 40] = bytes(40)
    path.write_bytes(content)


NO_IMPACTS = {
    "text": (lambda path, _: path.write_text("hello"), "is not a netCDF file of impacts: .*"),
    "another netCDF": (other_netcdf, "is not a file of impacts"),
    "truncated": (cut, "is not a netCDF file of impacts: .*"),
    "damaged": (damaged, "is not a netCDF file of impacts: .*"),
    "missing": (lambda *_: None, "cannot be read: no such file"),
}


@pytest.mark.parametrize("name", NO_IMPACTS)
def test_what_holds_no_impacts_is_refused(impacts, tmp_path, monkeypatch, capfd, name):
    monkeypatch.chdir(tmp_path)
    make, message = NO_IMPACTS[name]
    path = tmp_path / f"{name.replace(' ', '_')}.nc"  # new names, because HDF5 caches them
    make(path, impacts)
    refuses(["lab", "fit", path], f"{path.as_posix()}: {message}", capfd)
    if path.is_file():
        before = path.read_bytes()
        with pytest.raises(RockfallError, match=message):
            run_impacts(SMALL, path=path, resume=True)
        assert path.read_bytes() == before


ARGUMENTS = {
    "no command": (["lab"], "the following arguments are required: COMMAND: see rockfall lab .*"),
    "no layers": (["lab", "pack", "lab.nml", "--layers", "0"], "--layers 0: must be 1 or more"),
    "negative threads": (["lab", "impact", "lab.nml", "--threads=-1"],
        r"threads = -1: must be 0 \(all cores\) to 1024"),
    "folder of the output missing": (["lab", "impact", "lab.nml", "-o", "no/out.nc"],
        "no/out.nc: folder no does not exist"),
    "remake of what was not made": (["lab", "remake", "lab.nml"],
        "lab.nml: does not say what laboratory case it was made from"),
    "remake of bytes": (["lab", "remake", "bytes"], r"bytes: is not text \(UTF-8\)"),
    "one slope": (["lab", "scorecard", "--slopes", "1"], "--slopes 1: must be 2 or more"),
    "no site": (["lab", "scorecard", "--site", "."],
        r"\.: no case.nml there: the scorecard needs the folder cases/vaujany"),
    "scorecard of no sets": (["lab", "scorecard", "lab.nml"], "lab.nml: .*"),
}  # fmt: skip


@pytest.mark.parametrize("name", ARGUMENTS)
def test_bad_arguments_are_one_line_and_nothing_is_written(name, place, monkeypatch, capfd):
    Path("bytes").write_bytes(b"\x89PNG\xff")
    monkeypatch.setattr(remake, "run_impacts", None)  # must not be called
    words, message = ARGUMENTS[name]
    refuses(words, message, capfd)


@pytest.mark.parametrize("words", [["pack", "lab.nml", "-o", "layer.png"], ["fit", "lab.nc"]])
def test_without_the_report_extra_it_is_named(place, monkeypatch, capsys, words):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "threadpoolctl", None)
    refuses(["lab", *words], r".* needs the report extra: pip install .*", capsys)


def test_the_laboratory_case_is_one():
    case = read_lab_case(Path(__file__).parents[1] / "cases/rocky-slope/lab.nml")
    assert case.lab["layers"] >= 50 and case.lab["ratios"] == [1, 2, 3, 4, 5]
