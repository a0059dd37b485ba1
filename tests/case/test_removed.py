# SPDX-License-Identifier: BSD-3-Clause
"""Removing a key also removes the keys that are only valid with it, in one call."""

import pytest

import rockfall
from rockfall.case import given_groups
from rockfall.case.keys import FOREST, ONLY_WITH, keys_of

USUAL = {
    "case": {"boulders": 10},
    "terrain": {"dem": "dem.tif"},
    "surface": {"uniform_mean_radius": 0.3},
    "boulder": {"volume_mean": 1.0},
    "release": {"x": 5.0, "y": 5.0},
}
WOOD = {"seed": 4, "species_table": "kinds.csv", "clearings": "gaps.gpkg", "clearings_layer": "old"}
#: Group; removed keys; keys removed with them; keys given instead.
GROUPS = [
    (
        "surface",
        {"zones": "zones.gpkg"},
        {"zones_layer": "soil", "zone_field": "id", "table": "zones.csv", "default_zone": 3},
        {"uniform_mean_radius": 0.3},
    ),
    (
        "release",
        {"points": "blocks.gpkg"},
        {"points_layer": "big", "name_field": "id"},
        {"x": 5.0, "y": 5.0},
    ),
    (
        "release",
        {"polygons": "cliffs.gpkg"},
        {"polygons_layer": "high", "name_field": "id"},
        {"x": 5.0, "y": 5.0},
    ),
    (
        "forest",
        {"trees": "trees.gpkg"},
        WOOD | {"trees_layer": "lidar", "dbh_field": "d", "species_field": "s"},
        {},
    ),
    (
        "forest",
        {"polygons": "stands.gpkg"},
        WOOD | {"polygons_layer": "plan", "spread": "even"},
        {},
    ),
    ("output", {"maps": ["passages"]}, {"map_extent": "terrain", "min_passages": 3}, {}),
]


def made(group, keys):
    return rockfall.Case(**{**USUAL, group: keys})


@pytest.mark.parametrize(("group", "owner", "others", "instead"), GROUPS)
def test_one_call_removes_a_key_with_all_that_goes_with_it(group, owner, others, instead):
    case = made(group, owner | others)
    bare = case.replace(**{group: dict.fromkeys(owner) | instead})
    assert bare == made(group, instead)
    assert not {*owner, *others} & given_groups(bare).get(group, {}).keys()
    with pytest.raises(rockfall.RockfallError):  # a single key of these is refused
        made(group, others | instead)


@pytest.mark.parametrize(("group", "owner", "others", "instead"), GROUPS)
def test_each_of_them_would_be_refused(group, owner, others, instead):
    for key in others.keys() - {"clearings_layer"}:
        with pytest.raises(rockfall.RockfallError, match=f"{key}|surface"):
            made(group, {key: others[key]} | instead)
    known = {key for owners, keys in ONLY_WITH[group] if {*owner} & {*owners} for key in keys or ()}
    if group != "forest":
        assert known == others.keys() - ({"name_field"} - known)


def test_what_still_has_a_meaning_stays():
    case = made("release", {"points": "blocks.gpkg", "points_layer": "big", "name_field": "id"})
    other = case.replace(release={"points": None, "polygons": "cliffs.gpkg"})
    assert other.release["name_field"] == "id" and "points_layer" not in other.release
    wood = made("forest", {"trees": "t.gpkg", "trees_layer": "a", "seed": 4})
    stands = wood.replace(forest={"trees": None, "polygons": "p.gpkg"})
    assert stands.forest["seed"] == 4 and "trees_layer" not in stands.forest
    with pytest.raises(rockfall.RockfallError, match="zones is missing"):  # given in the same call
        made(*GROUPS[0][:1], {**GROUPS[0][1], **GROUPS[0][2]}).replace(
            surface={"zones": None, "table": "mine.csv"}
        )


def test_names_are_keys():
    for group, rows in ONLY_WITH.items():
        for owners, keys in rows:
            assert {*owners, *(keys or ())} <= keys_of(group).keys()
    assert keys_of("forest").keys() >= {*FOREST}
