# SPDX-License-Identifier: BSD-3-Clause
"""Figures of pages: drawn by tools/page_figures.py, small, and described in words."""

import re
import sys

import pytest

from programs import ROOT

pytest.importorskip("matplotlib", reason="the report extra is not installed")
sys.path.append(str(ROOT / "tools"))

import page_figures  # noqa: E402 - draws

PAGES = [
    path
    for pattern in ("README.md", "docs/**/*.md", "cases/*/README.md", "lab/**/*.md")
    for path in sorted(ROOT.glob(pattern))
    if ROOT / "docs/archive" not in path.parents
]
PICTURE = re.compile(r"!\[([^\]]*)\]")
SMALL = 100_000  # [bytes]


@pytest.mark.all
def test_every_figure_is_drawn_small_and_stands_on_a_page(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["page_figures.py", "-o", str(tmp_path), "--boulders", "100"])
    page_figures.main()
    texts = [path.read_text(encoding="utf-8") for path in PAGES]
    for name in page_figures.DRAWN:
        drawn, stored = tmp_path / f"{name}.png", ROOT / f"docs/figures/{name}.png"
        assert drawn.read_bytes().startswith(b"\x89PNG")
        assert stored.stat().st_size < SMALL
        assert any(f"figures/{name}.png" in text for text in texts), name


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_pictures_have_a_description(path):
    for words in PICTURE.findall(path.read_text(encoding="utf-8")):
        assert len(words.split()) > 3, words
