# SPDX-License-Identifier: BSD-3-Clause
"""Validation results are only in python/rockfall/data/field_evidence.csv: pages show them in blocks
filled by tools/document.py, messages by placeholders."""

import ast
import math
import re
import sys
from datetime import date
from pathlib import Path

import pytest

from rockfall.evidence import error_range, evidence, largest_error, only, table
from rockfall.language import LANGUAGES, catalogue

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tools"))

from document_evidence import BLOCK, BLOCKS, filled  # noqa: E402

PAGES = [
    path
    for pattern in ("README.md", "docs/**/*.md", "cases/*/README.md")
    for path in sorted(ROOT.glob(pattern))
    if ROOT / "docs/archive" not in path.parents
]
#: Sentences without evidence, identified by words in them.
OTHER = {
    "observed blocks stopped within": "of the observation alone",
    "standard deviation within 25 % of the observed values": "bounds of verdicts",
    "more than 5 % of its boulders exceed": "the bound of a warning",
}
NUMBER = re.compile(
    r"\d ?%|\b(?:a|one|two|three|four) (?:third|quarter|fifth|sixth|seventh|tenth|half)s?\b"
    r"|\d times\b",
    re.IGNORECASE,
)
COMPARED = re.compile(
    r"\b[Tt]oo (?:short|long|low|high|small|large|slow|fast|weak|strong|far)\b"
    r"|(?<!vaujany-)\bobserved\b|\b[Hh]eld[- ]out\b|\bVaujany\b|\bTschamut\b|\bexperiment\b"
    r"|\bin the field\b|\bdid\b|\b(?:blocks|boulders) went\b"
)
LEVELS = re.compile(r"\b(?:1|5|50|90|95) % (?:confidence|of the draws|quantile|interval)|of 95 %")
#: Words for fractions in the messages of other languages.
PARTS = re.compile(r"\d ?%|Viertel|Drittel|Zehntel|\bquart\b|\btiers\b|\bquarto\b|\bterzo\b")


def sentences(page: str) -> list[str]:
    """Sentences, list items and table rows of a page, without code and generated blocks."""
    page = re.sub(r"<!-- ([^>]*?) -->\n.*?<!-- end of .*? -->", "", page, flags=re.DOTALL)
    page = re.sub(r"^(```|~~~).*?^\1", "", page, flags=re.DOTALL | re.MULTILINE)
    parts = re.split(r"\n(?=\||\s*[-*] |#)|\n\n", page)
    return [
        sentence
        for part in parts
        for sentence in re.split(r"(?<=[.:;?!]) ", " ".join(part.split()))
    ]


def holds_a_number(sentence: str) -> bool:
    """Return True if a sentence quantifies agreement with observations."""
    rest = LEVELS.sub("", sentence)
    return bool(NUMBER.search(rest) and COMPARED.search(rest))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_page_holds_a_number_of_validity_of_its_own(path):
    """Pages give agreement with observations only in blocks made by tools/document_evidence.py."""
    own = [
        sentence
        for sentence in sentences(path.read_text(encoding="utf-8"))
        if holds_a_number(sentence) and not any(words in sentence for words in OTHER)
    ]
    assert not own, "\n".join(own)


@pytest.mark.parametrize(
    "sentence",
    [
        "On a pasture its mean run-out is 71 % too short.",
        "48 % of the boulders pass the trees, where 34 % did.",
        "The held-out mean is 7 % too long.",
        "Deviations at Vaujany are three tenths too small.",
        "Boulders on the pasture of Tschamut go 3 times as far.",
        "Rows of soil stop them at [a sixth to a half](page.md) of the way that blocks went:",
        "Means are within 7 % of those observed.",
    ],
)
def test_the_rule_finds_such_numbers(sentence):
    assert holds_a_number(sentence)


@pytest.mark.parametrize(
    "sentence",
    [
        "Brackets are 95 % confidence intervals of what was observed.",
        "On `cases/vaujany` a rebound takes 8 % less time.",
        "More pass than in the experiment.",
    ],
)
def test_the_rule_leaves_other_numbers(sentence):
    assert not holds_a_number(sentence)


def test_exempt_pages_and_sentences_exist():
    texts = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in PAGES}
    for words in OTHER:
        assert any(words in " ".join(text.split()) for text in texts.values()), words


def test_every_block_is_filled_from_the_table():
    pages = {path: path.read_text(encoding="utf-8") for path in PAGES}
    used = {name for text in pages.values() for _, name, _ in BLOCK.findall(text)}
    assert used == {*BLOCKS}
    stale = [path.name for path, text in pages.items() if filled(text) != text]
    assert not stale, "run python tools/document.py"


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_message_on_validity_holds_a_number(language):
    forms = catalogue(language).forms
    own = [
        text
        for key, texts in forms.items()
        for text in texts
        if key.startswith(("model.", "validity.")) and (PARTS.search(text) or NUMBER.search(text))
    ]
    assert not own


def test_no_message_elsewhere_compares_with_a_site():
    """No message and no string in the package has a number and the name of a site."""
    texts = [text for forms in catalogue("en").forms.values() for text in forms]
    for path in sorted((ROOT / "python/rockfall").rglob("*.py")):
        nodes = [*ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
        documentation = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        texts += [
            node.value
            for node in nodes
            if isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in documentation
        ]
    site = re.compile(r"\bVaujany\b|\bTschamut\b|\b(?:run-outs?|speeds?|energ(?:y|ies)) were\b")
    assert len(texts) > 5000
    assert not [text for text in texts if site.search(text) and NUMBER.search(text)]


def test_rows_are_sound():
    rows = table()
    assert len({row.key for row in rows}) == len(rows) > 200
    for row in rows:
        assert math.isfinite(row.error) and not row.standard_error < 0, row
        assert date.fromisoformat(row.date) and re.fullmatch(r"[\d.]+\+[0-9a-f]{8}", row.version)
        module = re.match(r"python (?:-m )?(\S+)", row.command)[1].removesuffix(".py")
        assert (ROOT / f"{module.replace('.', '/')}.py").is_file(), row.command


def test_rows_are_chosen_by_site_place_quantity_and_model():
    rows = evidence("vaujany", "EL2", "*_mean", "talus")
    assert [row.quantity for row in rows] == [
        f"{quantity}_mean" for quantity in ("speed", "passing_height", "energy_translational")
    ]
    assert largest_error(rows) == round(max(abs(row.error) for row in rows))
    assert error_range(rows) == (
        round(min(row.error for row in rows)),
        round(max(row.error for row in rows)),
    )
    with pytest.raises(LookupError, match="0 rows of vaujany, EL3"):
        only("vaujany", "EL3", "speed_mean", "talus")


def test_numbers_of_the_model_come_from_errors():
    """The simulated value follows from the observed value and the error in percent; for a statistic
    that is not observed, it is the error itself."""
    passing = only("vaujany-forest", "forest", "passing", "vaujany-observed")
    assert passing.simulated == pytest.approx(34 * (1 + passing.error / 100))
    assert passing.simulated_error == pytest.approx(0.34 * passing.standard_error)
    distance = only("tschamut", "held-out", "run_out_ks", "meadow")
    assert (distance.simulated, distance.simulated_error) == (
        distance.error,
        distance.standard_error,
    )
