# SPDX-License-Identifier: BSD-3-Clause
"""Theory manual: equations have numbers and sources, and refer to code that exists."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MANUAL = ROOT / "docs/theory"
LAB = ROOT / "lab/docs"
REFERENCES = [folder / "15-references.md" for folder in (MANUAL, LAB)]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *LAB.glob("*.md")])
CHAPTERS = sorted([*MANUAL.glob("*.md"), *LAB.glob("14*.md")], key=lambda path: path.name)
CHAPTERS.remove(REFERENCES[0])
EQUATION = re.compile(r'<a id="eq-([\w-]+)"></a>\n\n\$\$\n(.+?)\n\$\$\n\n(.+?)\n\n', re.DOTALL)
NUMBER = re.compile(r"(\d+)\.(\d+)([a-z]?)")
ANCHOR = re.compile(r'<a id="([\w-]+)"></a>')
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s]*)\)")


def text_of(path):
    return path.read_text(encoding="utf-8") + "\n"


def equations(path):
    """Anchor and formula of each equation on a page, and the paragraph after it."""
    return EQUATION.findall(text_of(path))


@cache
def defined(path):
    """Names of procedures defined in a file; for Python also of classes, and Class.method."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".f90":
        return {*re.findall(r"^[^!'\"\n]*\b(?:function|subroutine)\s+(\w+)", text, re.MULTILINE)}
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            body = [one.name for one in node.body if isinstance(one, ast.FunctionDef)]
            found |= {f"{node.name}.{name}" for name in body}
    return found


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_equations_are_numbered(path):
    found = equations(path)
    text = text_of(path)
    assert len(found) == text.count("$$") / 2 == text.count(r"\tag{"), "one tag, anchor and source"
    places = []
    for anchor, formula, _ in found:
        (tag,) = re.findall(r"\\tag\{(.+?)\}", formula)
        chapter, number, letter = NUMBER.fullmatch(tag).groups()
        assert int(chapter) == int(path.stem[:2]), f"({tag}) is of another chapter"
        assert anchor == tag.replace(".", "-"), f"the anchor of ({tag}) is eq-{anchor}"
        places.append((int(number), letter))
    assert places == sorted({*places}), "numbers are unique and in order"


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_equations_name_source_and_code(path):
    for anchor, _, about in equations(path):
        source, code = re.fullmatch(
            r"\*Source\*: (.+) \*Code\*: (.+)\.", " ".join(about.split())
        ).groups()
        assert len(source) > 4, anchor
        for part in code.split("; "):
            file, *names = re.findall(r"`([^`]+)`", part)
            assert names, f"({anchor}) names no procedure of {file}"
            missing = {*names} - defined(ROOT / file)
            assert not missing, f"({anchor}): {file} has no {missing}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path):
    prose = re.sub(r"```.*?```|`[^`\n]*`", "", text_of(path), flags=re.DOTALL)
    for label, target in LINK.findall(prose):
        file, _, anchor = target.partition("#")
        if "://" in file:
            continue
        page = (path.parent / file).resolve() if file else path
        if page.is_relative_to(ROOT / "docs/figures/generated"):
            continue  # made with the site, which checks links separately
        assert page.exists(), f"[{label}]({target})"
        if page in REFERENCES or anchor.startswith("eq-"):
            assert not anchor or anchor in ANCHOR.findall(text_of(page)), f"[{label}]({target})"
        if NUMBER.fullmatch(label.strip("()")):
            assert f"eq-{label.strip('()').replace('.', '-')}" == anchor, f"[{label}]({target})"


def test_files_named_in_the_text_exist():
    file = re.compile(r"`((?:fortran|python|tests|lab)/[\w./]+)`")
    for path in [*CHAPTERS, *(ROOT / "docs/validation").glob("*.md"), LAB / "validation.md"]:
        for name in file.findall(text_of(path)):
            assert (ROOT / name).exists(), f"{path.name}: {name}"


def test_every_reference_is_cited():
    cited = {
        anchor for path in PAGES for anchor in re.findall(r"15-references\.md#(\w+)", text_of(path))
    }
    listed = [anchor for page in REFERENCES for anchor in ANCHOR.findall(text_of(page))]
    assert sorted(cited) == sorted(listed), "each reference is cited, and listed once"
