# SPDX-License-Identifier: BSD-3-Clause
"""Only the kernel reads namelist text: values arrive in their types, given values are distinguished
from defaults, and text written by Python reads as equal values."""

import pickle
import re
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

import rockfall
from rockfall.case import REPEATABLE, broken_rule, default_values, given_groups, key_table
from rockfall.case.text import Entry, Group, case_text, namelist_text, read_groups, read_values
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.scene.rebounds.coefficients import open_sets

ROOT = Path(__file__).parents[2]
SHIPPED = [path for home in (ROOT, ROOT / "lab") for path in sorted(home.glob("cases/*/*.nml"))]
CASE = """
&case boulders = +007, title = "it's ""rough"" \\ " /
&terrain dem = 'a''b.tif' / ! a comment, with & and /
&Surface uniform_rg = 3*.5, method = 'A' /
&boulder volume = 'list', volumes = 2*1d0, 1.5E+2 +3. 00.50e-03 /
&release x = 1, 2 Y = 3 -.5 steep_cells = F drop_height = 45 /
&impact table = 'talus' /
&line name = 'road', x = 0, 1 y = 2*3 /
&dam file = 'dams.gpkg', slope = 30 /
&dam x = 0, 1, y = 0, 0, height = 2 /
&output maps = 'passages', kept = 50 /
"""
TEXTS = some.text(
    some.characters(exclude_categories=["Cs", "Cc"]) | some.just("\t"), min_size=1, max_size=40
)
REALS = some.floats(allow_nan=False, allow_infinity=False)
#: The same values each time, however slow the machine.
untimed = settings(
    max_examples=50, deadline=None, derandomize=True, database=None,
    suppress_health_check=[*HealthCheck],
)  # fmt: skip


def read(text):
    return read_values(text.encode(), "text", "case")


def groups(text):
    return {group.name: group for group in read(text).groups if group.name not in REPEATABLE}


def test_values_have_the_types_of_their_keys():
    found = groups(CASE)
    assert found["case"].given == {"boulders": 7, "title": 'it\'s "rough" \\ '}
    assert found["terrain"].given == {"dem": "a'b.tif"}
    assert found["boulder"].given["volumes"] == [1.0, 1.0, 150.0, 3.0, 0.0005]
    release = found["release"].given
    assert release == {
        "x": [1.0, 2.0], "y": [3.0, -0.5], "drop_height": 45.0,
    }  # fmt: skip
    assert type(release["drop_height"]) is float and type(release["x"][0]) is float
    assert found["output"].given == {"maps": ["passages"], "kept": 50}


def test_what_is_given_is_told_from_defaults():
    """`given` has values that differ from the defaults, `usual` has defaults."""
    found = groups(CASE)
    assert "seed" not in found["case"].given and found["case"].usual["seed"] == 1
    assert found["impact"].given == {"form": "table"}  # implied by the table
    assert found["impact"].usual["table"] == "talus"
    assert groups(CASE.replace("talus", "meadow"))["impact"].given == {
        "form": "table", "table": "meadow",
    }  # fmt: skip
    for written in "9.81", "981e-2":
        flight = groups(f"{CASE}&flight gravity = {written} /")["flight"]
        assert not flight.given and flight.usual == {"gravity": 9.81}
    case = rockfall.read_case(ROOT / "cases/vaujany/case.nml")
    again = rockfall.Case(folder=case.folder, **given_groups(case), line=case.line)
    assert again == case and given_groups(again) == given_groups(case)


def test_a_layer_may_give_what_has_a_default():
    layer, dam = (group for group in read(CASE).groups if group.name == "dam")
    assert layer.all() == {"file": "dams.gpkg", "slope": 30.0}
    assert dam.usual == {"crest_width": 0.0, "slope": 45.0, "allow_coarse": False}


def test_every_default_of_the_table_is_handed_out():
    for key in key_table():
        usual = default_values()[key.group].get(key.name)
        assert (usual is None) == (key.default in ("required", "absent")), key
        if usual is not None:
            assert read_groups(f"&{key.group} {key.name} = {key.default} /", "default") == {
                key.group: {key.name: usual if key.most == 1 or len(usual) > 1 else usual[0]}
            }


def test_limits_of_a_key_are_those_by_which_its_numbers_are_refused():
    limited = [key for key in key_table() if key.low is not None and key.kind == "real"]
    assert len(limited) > 50
    for key in limited:
        inside = key.low if not key.allowed.startswith("> ") else 1e-9
        assert not broken_rule(key.group, key.name, inside), key
        assert broken_rule(key.group, key.name, key.low - 1), key
        if key.high is not None:
            assert key.allowed in broken_rule(key.group, key.name, 1.5 * key.high + 1), key
            assert not broken_rule(key.group, key.name, key.high), key


def test_another_value_leaves_defaults_to_the_kernel():
    """Replacing a key leaves the defaults of others to the kernel: with a table, the default form
    is no longer 'matrix'."""
    case = rockfall.Case(
        case={"boulders": 1}, surface={"uniform_mean_radius": 0.3}, boulder={"volume_mean": 1.0},
        release={"x": [0.0], "y": [0.0]},
    )  # fmt: skip
    assert case.impact["form"] == "matrix"
    assert case.replace(impact={"table": "talus"}).impact["form"] == "table"
    again = case.replace(impact={"table": "talus"}).replace(impact={"table": None})
    assert again == case and given_groups(again) == given_groups(case)


@pytest.mark.all
@untimed
@given(
    some.dictionaries(
        some.from_regex(r"\A[a-z][a-z0-9_]{0,9}\Z"),
        some.booleans() | TEXTS | REALS | some.integers(-(2**63) + 1, 2**63 - 1)
        | some.lists(REALS, min_size=2, max_size=30) | some.lists(TEXTS, min_size=2, max_size=5),
        min_size=1, max_size=8,
    )
)  # fmt: skip
def test_what_is_written_reads_as_equal_values(values):
    for text in (
        namelist_text({"group": values}),
        namelist_text({"group": [values]}, indent=2),
        case_text(["head"], [Group("group", [Entry(*item, "why / &") for item in values.items()])],
                  ["foot"]),
    ):  # fmt: skip
        found = read_groups(text, "text")
        assert found == {"group": values}
        assert repr(sorted(found["group"].items())) == repr(sorted(values.items()))  # types, -0.0


@pytest.mark.all
@untimed
@given(
    some.from_regex(r"\A[+-]?([0-9]{1,25}\.?[0-9]{0,25}|\.[0-9]{1,25})([eEdD][+-]?[0-9]{1,3})?\Z")
)
def test_a_real_is_the_nearest_double_however_it_is_spelled(word):
    exact = Decimal(word.lower().replace("d", "e"))
    nearest = float(exact)
    text = f"&case boulders = 1 / &terrain dem = 'a' / &surface uniform_mean_radius = 1 / \
             &boulder volume_mean = 1 / &release x = {word}, y = 1 /"
    if abs(nearest) > 1e12:
        with pytest.raises(rockfall.RockfallError, match="&release x"):
            read(text)
    else:
        found = groups(text)["release"].given["x"]
        assert repr(found) == repr([nearest])


def test_long_lists_arrive_whole():
    """A list written with a repeat count has 100,000 values."""
    found = groups(
        "&case boulders = 1 / &terrain dem = 'a' / &surface uniform_mean_radius = 1 / "
        "&boulder volume = 'list', volumes = 100000*0.125 / &release x = 1, y = 1 /"
    )
    assert found["boulder"].given["volumes"] == 100000 * [0.125]


@pytest.mark.parametrize("path", SHIPPED, ids=str)
def test_shipped_files_are_read_and_written_again(path):
    def read(text):
        found = read_values(text, str(path)).groups
        names = sorted({group.name for group in found})
        return {name: [group.given for group in found if group.name == name] for name in names}

    found = read(path.read_bytes())
    assert found and read(namelist_text(found).encode()) == found


def test_a_case_can_be_copied_by_pickle():
    case = rockfall.read_case(ROOT / "cases/vaujany/case.nml")
    assert pickle.loads(pickle.dumps(case)) == case


def test_changes_in_place_stay_in_copies():
    """A copy has the changed values, the default of a removed key, and the new line."""
    case = rockfall.Case(
        case={"boulders": 1}, surface={"uniform_mean_radius": 0.3},
        boulder={"volume_mean": 1.0, "density": 2500.0},
        release={"x": [1.0], "y": [2.0]}, line=[{"name": "road", "x": [0.0, 1.0], "y": [3.0, 3.0]}],
    )  # fmt: skip
    case.boulder["volume_mean"] = 2.0
    del case.boulder["density"]
    case.line[0]["x"][1] = 6.0
    case.line.append({"name": "new", "x": [0.0, 5.0], "y": [1.0, 1.0]})
    copied = case.replace(case={"seed": 9})
    assert copied.boulder["volume_mean"] == 2.0 and copied.boulder["density"] == 2800.0
    assert [line["name"] for line in copied.line] == ["road", "new"]
    assert copied.line[0]["x"] == [0.0, 6.0] and copied.case["seed"] == 9


def test_arrays_and_paths_are_values():
    case = rockfall.read_case(ROOT / "cases/vaujany/case.nml")
    places = {"x": np.array([1.5, 2.5]), "y": (np.float32(3), np.int64(4))}
    other = case.replace(line=[{"name": "L", **places}], terrain={"dem": Path("other") / "dem.tif"})
    assert other.line == [{"name": "L", "x": [1.5, 2.5], "y": [3.0, 4.0]}]
    assert other.terrain["dem"] == str(Path("other/dem.tif"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "&case boulders = 1\n sed = 2 /",
            "text: line 2: &case sed: unknown key (similar keys: seed, ",
        ),
        (
            "&case boulders = 1 /\n\n&cases /",
            "text: line 3: &cases: unknown group (similar groups: &case",
        ),
        ("&case seed = 1, seed = 2 /", "text: line 1: &case seed: is given twice in this group"),
        ("&case boulders = 1.5 /", "text: &case boulders = 1.5: must be an integer"),
        ("&case title = 1 /", "text: &case title = 1: must be text in quotes"),
        (
            "&case boulders = 1 /\n&case seed = 2 /",
            "text: line 1: &case: this group must occur only once",
        ),
        ("&case boulders = 1", "text: line 1: &case is not closed by /"),
        ("&case title = 'a\x07' /", "text: line 1: character code 7 is not text"),
        ("&case title = 'a\0' /", "text: character code 0 is not text"),
        ("", "text: &terrain dem is missing"),
    ],
)
def test_faults_name_their_place_and_what_is_allowed(text, said):
    with pytest.raises(rockfall.RockfallError, match="^" + re.escape(said)):
        read(text)


def test_a_file_of_sets_is_not_read_up_to_a_zero(tmp_path):
    path = tmp_path / "sets.nml"
    path.write_bytes(shipped_sets()["vaujany-observed"].read_bytes() + b"\0 &more /")
    with pytest.raises(rockfall.RockfallError, match="sets.nml: character code 0 is not text"):
        open_sets(path).read("past_aspect")
