# SPDX-License-Identifier: BSD-3-Clause
"""Locked versions and recipes agree with pyproject.toml."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
ABOUT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = ABOUT["project"]
BUILD = [*map(Requirement, ABOUT["build-system"]["requires"])]
RECIPE = (ROOT / "packaging/conda/recipe.yaml").read_text("utf-8")


def required(name):
    """Yield the requirements of an extra, or of the package itself for ""."""
    extras = PROJECT["optional-dependencies"]
    for one in map(Requirement, extras[name] if name else PROJECT["dependencies"]):
        if one.name != PROJECT["name"]:
            yield one
        for extra in one.extras if one.name == PROJECT["name"] else ():
            yield from required(extra)


def locked(name):
    """Versions of each package in a lock file; several if they depend on the version of Python."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text()
    entries = re.findall(r"^([\w.-]+)==(\S+)(.*(?:\n +--hash=.*)+)", text, re.MULTILINE)
    assert len(entries) == len(re.findall(r"^[^ #]", text, re.MULTILINE)), (
        "a line that is no pinned package with hashes"
    )
    versions = {}
    for package, version, rest in entries:
        assert "--hash=sha256:" in rest, package
        versions.setdefault(canonicalize_name(package), []).append(version)
    return versions


@pytest.mark.parametrize(
    "lock, needs",
    [("test", [*required(""), *required("test"), *BUILD]), ("wheel", BUILD)],
)
def test_lock_files_hold_what_is_required(lock, needs):
    versions = locked(lock)
    for need in needs:
        found = versions.get(canonicalize_name(need.name))
        assert found, f"{need.name} is not in requirements/{lock}.txt: ./run lock"
        for version in found:
            assert version in need.specifier, f"{need} is locked as {version}: ./run lock"


def test_wheels_are_built_by_what_the_tests_build_with():
    test, wheel = locked("test"), locked("wheel")
    assert all(wheel[canonicalize_name(need.name)] == test[need.name.lower()] for need in BUILD)


@pytest.mark.parametrize(
    "section, end, needs", [("host", "run", BUILD), ("run", "", [*required("")])]
)
def test_the_conda_recipe_asks_for_the_same(section, end, needs):
    block = RECIPE.partition(f"\n  {section}:\n")[2].partition(f"\n  {end}:" if end else "\n\n")[0]
    lines = {line.strip().removeprefix("- ") for line in block.splitlines()}
    for need in needs:
        assert f"{need.name.lower()} {need.specifier}".strip() in lines, need


def test_wheels_are_for_the_pythons_that_are_named():
    minors = re.findall(r"Python :: 3\.(\d+)", "\n".join(PROJECT["classifiers"]))
    built = re.findall(r"cp3(\d+)-\*", ABOUT["tool"]["cibuildwheel"]["build"])
    assert minors == built and minors[0] in PROJECT["requires-python"]
