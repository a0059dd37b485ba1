# SPDX-License-Identifier: BSD-3-Clause
"""One version everywhere, and correct statements on front pages."""

import ast
import re
from pathlib import Path

import pytest

import rockfall
from rockfall.case import key_table
from rockfall.case.text import read_groups

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "SECURITY.md",
         "docs/comparison.md", "docs/stability_policy.md", "docs/cluster.md")  # fmt: skip
README = (ROOT / "README.md").read_text(encoding="utf-8")
VERSION = re.search(r"version: '([0-9.]+)'", (ROOT / "meson.build").read_text())[1]


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_version_is_the_same_everywhere():
    assert rockfall.__version__ == VERSION
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    date = re.search(r'^date-released: "?([^"\n]+)"?$', citation, re.MULTILINE)[1]
    recipe = (ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8")
    assert {*re.findall(r'^ *version: "?([0-9.]+)"?$', citation + recipe, re.MULTILINE)} == {
        VERSION
    }
    newest = re.search(r"^## (\S+)(?: - (\S+))?", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest[1] == "Unreleased" or newest.groups() == (VERSION, date)


def test_the_readme_is_short():
    prose = re.sub(r"```.*?```", "", README, flags=re.DOTALL)
    assert len(re.sub(r"\]\([^)]*\)", "]", prose).split()) <= 500
    assert "limits" in README[:2500].lower(), "the limits are on the first screen"


def test_the_case_of_the_readme_is_a_case():
    (text,) = blocks("fortran")
    known = {(key.group, key.name) for key in key_table()}
    for group, keys in read_groups(text, "README.md").items():
        assert {(group, name) for name in keys} <= known
    assert len(text.splitlines()) <= 10


def test_python_of_the_readme_uses_public_names():
    (text,) = blocks("python")
    names = {
        node.attr
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "rockfall"
    }
    assert names and names <= {*rockfall.__all__}


@pytest.mark.parametrize("page", PAGES)
def test_pages_are_narrow_and_their_links_lead_somewhere(page):
    path = ROOT / page
    text = path.read_text(encoding="utf-8")
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    for link in re.findall(r"\]\(([^)]+)\)", prose):
        if not re.match(r"https?:|mailto:|#", link):
            assert (path.parent / link.partition("#")[0]).exists(), link
    for line in prose.splitlines():
        assert len(line) <= 100 or re.search(r"^\||\]\(|^\s*<https?:", line), line
