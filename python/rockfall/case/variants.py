# SPDX-License-Identifier: BSD-3-Clause
"""Variants of a case: each &variant group defines a case by its differences from the rest of the
case. All share the seed and thus common random numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rockfall.case.case import Case, given_groups
from rockfall.case.keys import REPEATABLE, varied_key
from rockfall.case.rules import BASE, CHOSEN
from rockfall.case.text import literal, namelist_text
from rockfall.errors import RockfallError


def variants(case: Case) -> dict[str, Case]:
    """Return the cases of the &variant groups by name, in order; empty without such groups.

    Raises a RockfallError for an invalid variant, or for equal variants.

    >>> import rockfall
    >>> net = {"name": "net", "x": [600000.0, 600120.0], "y": [4999950.0, 4999950.0]}
    >>> case = rockfall.read_case("case.nml").replace(
    ...     barrier=[net | {"height": 3.0, "class": 4}],
    ...     variant=[{"name": "bare", "without": ["barrier"]}, {"name": "with net"}],
    ... )
    >>> {name: len(one.barrier) for name, one in rockfall.variants(case).items()}
    {'bare': 0, 'with net': 1}
    """
    cases: dict[str, Case] = {}
    names: dict[str, str] = {}  # name of the first variant with these contents
    for given in case.variant:
        name, made = given["name"], _variant(case, given)
        first = names.setdefault(_contents(made), name)
        if first != name:
            raise RockfallError(
                f"{case.name}: &variant name = {literal(name)}: equals variant {literal(first)}: "
                "change a key, or omit one of the two"
            )
        cases[name] = made
    return cases


def chosen_variant(case: Case, name: str | None) -> Case:
    """Variant with this name; BASE selects the case without variants. Without a name, the case
    itself, which must then have no variants. Raises a RockfallError for an unknown name."""
    if name is None:
        check_single(case)
        return case
    by_name = variants(case)
    if by_name:
        by_name[BASE] = case.replace(variant=[])
    if name not in by_name:
        has = f"variants: {', '.join(by_name)}" if by_name else "the case has no &variant"
        raise RockfallError(f"{case.name}: --variant {name}: unknown ({has})")
    return by_name[name]


def check_single(case: Case) -> None:
    """Raise a RockfallError for a case with variants: a run needs a single variant."""
    if case.variant:
        names = ", ".join(variant["name"] for variant in case.variant)
        raise RockfallError(
            f"{case.name}: &variant: has variants {names}: run all with `rockfall variants`, one "
            "with --variant NAME (in Python rockfall.variants(case)[NAME]), or none with "
            f"--variant {BASE}"
        )


def _variant(case: Case, given: Mapping[str, Any]) -> Case:
    """Case defined by a &variant group. Refuses to remove a group that the case lacks."""
    where = f"{case.name}: &variant name = {literal(given['name'])}"
    title = case.case["title"]
    changes: dict[str, Any] = {"variant": []}
    changes["case"] = {"title": f"{title}: {given['name']}" if title else given["name"]}
    for group in given.get("without", []):
        own = getattr(case, group)
        if not own or not (isinstance(own, list) or group in given_groups(case)):
            raise RockfallError(f"{where} without = '{group}': the case has no &{group}")
        changes[group] = [] if isinstance(own, list) else dict.fromkeys(own)
    for key, group in CHOSEN.items():
        if key in given:
            changes[group] = _named(case, group, given[key], f"{where} {key}")
    for key, value in given.items():
        if (varied := varied_key(key)) is not None:
            group, name = varied
            changes.setdefault(group, {})[name] = value
    with naming_variant(case, given["name"]):
        return case.replace(**changes)


def _contents(case: Case) -> str:
    """Text of a case without its title."""
    groups = given_groups(case)
    groups["case"] = {key: own for key, own in groups["case"].items() if key != "title"}
    return namelist_text(groups | {group: getattr(case, group) for group in REPEATABLE})


@contextmanager
def naming_variant(case: Case, name: str) -> Iterator[None]:
    """Within the block, errors about the variant's case start with the name of the variant."""
    try:
        yield
    except RockfallError as error:
        rule = str(error).removeprefix(f"{case.name}: ")
        where = f"{case.name}: &variant name = {literal(name)}"
        raise RockfallError(f"{where}: {rule}", error.code) from error


def _named(case: Case, group: str, names: list[str], where: str) -> list[dict[str, Any]]:
    """Groups with these names; raises a RockfallError for an unknown name."""
    own = [(_name(item), item) for item in getattr(case, group)]
    called = list(dict.fromkeys(name for name, _ in own if name))
    for name in names:
        if name not in called:
            those = f"names: {', '.join(called)}" if called else f"no &{group} has a name"
            raise RockfallError(f"{where}: unknown &{group} '{name}' ({those})")
    return [item for name, item in own if name in names]


def _name(given: Mapping[str, Any]) -> str:
    """Name of a group; by default the name of its layer or file."""
    stem = Path(given["file"]).stem if "file" in given else ""
    return str(given.get("name") or given.get("layer") or stem)
