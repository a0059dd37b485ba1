# SPDX-License-Identifier: BSD-3-Clause
"""Maximum length of pages, except generated and archived pages."""

import pytest

from programs import ROOT

#: Written by tools/document.py from tables of the program.
WRITTEN = {"api", "case", "cli", "glossary", "ground_table", "result"}
PAGES = [
    path
    for path in sorted((ROOT / "docs").rglob("*.md"))
    if "archive" not in path.parts and path.stem not in WRITTEN
]
MOST, MOST_OF_ALL = 1500, 75_000


def words(path):
    return len(path.read_text(encoding="utf-8").split())


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_page_is_short(path):
    assert words(path) <= MOST, "split it by purpose, or shorten it"


def test_all_pages_together_are_a_book_of_limited_size():
    assert sum(map(words, PAGES)) <= MOST_OF_ALL
