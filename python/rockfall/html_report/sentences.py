# SPDX-License-Identifier: BSD-3-Clause
"""Translation of English sentences that other parts of the program make, by their words.

Texts of the page itself have message ids: see `rockfall.language`. The others are written in
English where they arise, also for terminals. For a page their numbers become `#` and names of the
case `@`; the resulting text is looked up in data/report_texts.csv, and the numbers and names are
inserted again, in order.
"""

from __future__ import annotations

import csv
import importlib.resources
import logging
import re
from collections.abc import Iterable
from functools import cache
from textwrap import fill
from typing import TYPE_CHECKING

from rockfall.language import Text, localised

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = re.compile(r"(?<![\w.])(?:[<>] |[-+](?=\d))?\d+(?:,\d{3})*(?:\.\d+)?(?=kJ|years|\W|_?$)")
#: Symbols and units, the same in all languages.
SYMBOL = re.compile(
    r"(?<!\w)(?:[A-Za-z]+_[\w,]+|k?m[23²³]?|k?J|kg|rad|[stxyzpDnN]|UNI|ONR|EAD|SHA|CPU)(?!\w)"
)
BREAKS = ("\n", ". ", "; ", ": ")  # split texts that the catalogue lacks
log = logging.getLogger(__name__)


@cache
def catalogue(language: str) -> dict[str, str]:
    """English texts and their translations."""
    path = importlib.resources.files("rockfall") / "data" / "report_texts.csv"
    rows = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    return {row["en"]: row[language] for row in rows}


class Speaker:
    """Translator of texts; `names`, from the case, are unchanged."""

    def __init__(self, language: str = "en", names: Iterable[str] = ()) -> None:
        self.language, self.texts = language, catalogue(language)
        known = sorted({name for name in names if name.strip()}, key=len, reverse=True)
        either = "|".join(map(re.escape, known)) or "(?!)"
        self.name = re.compile(rf"(?<!\w)(?:{either}|[a-z]+(?:_[a-z]+)+\d*)(?!\w)")

    def __call__(self, text: object) -> str:
        """Translate a text; a text missing from the catalogue is returned unchanged, and logged."""
        if isinstance(text, Text):
            return text
        said = str(text)
        if "\n" in said.strip():  # cells of tables have several lines
            return "\n".join(map(self, said.split("\n")))
        inner = said.strip()
        return said if self.language == "en" else said.replace(inner, self._said(inner), 1)

    def _said(self, text: str) -> str:
        if self.name.fullmatch(text):
            return text
        found = self._found(text)
        if found is not None:
            return found
        if text.endswith(".") and (found := self._found(text[:-1])):
            return f"{found}."
        for one in BREAKS:
            if one in text:
                joint = re.sub("([;:])", "\u202f\\1", one) if self.language == "fr" else one
                return joint.join(map(self._said, text.split(one)))
        if titled := re.fullmatch(r"(.+?) \[(.+)\](,? ?)(.*)", text):
            label, unit, joint, rest = map(self._said, titled.groups())
            return f"{label} [{unit}]{joint}{rest}"
        log.warning("%s: no text for '%s'", self.language, text)
        return self._marked(text)

    def _found(self, text: str) -> str | None:
        """Text in the catalogue, with masks filled: exact, or with names of the case in it."""
        for names in ([], self.name.findall(text)[:1], self.name.findall(text)):
            masked = self.name.sub("@", text, count=len(names)) if names else text
            key = NUMBER.sub("#", " ".join(masked.split()))
            if not re.search("[^\\W\\d_]", SYMBOL.sub("", key)):
                return self._marked(text)
            capital = key not in self.texts
            if capital:
                key = key[:1].lower() + key[1:]
            if key in self.texts:
                found = self.texts[key]
                found = found[:1].upper() + found[1:] if capital else found
                return self._filled(found, NUMBER.findall(masked), names)
        return None

    def _filled(self, text: str, numbers: list[str], names: list[str]) -> str:
        fillings = {"#": map(self._marked, numbers), "@": iter(names)}
        return re.sub("[#@]", lambda mask: next(fillings[mask[0]]), text)

    def _marked(self, text: str) -> str:
        """Text with numbers in the format of the language."""
        return NUMBER.sub(lambda number: localised(number[0], self.language), text)

    def figure(self, figure: Figure) -> None:
        """Translate all texts of a figure, and format the numbers on its axes."""
        from matplotlib.text import Text
        from matplotlib.ticker import FixedFormatter, FuncFormatter, ScalarFormatter

        if self.language == "en":
            return
        speaker = self

        class Marked(ScalarFormatter):
            def __call__(self, x: float, pos: int | None = None) -> str:
                return speaker._marked(super().__call__(x, pos))

        said_of: list[object] = []  # axes with shared ticks share their formatter
        for axes in figure.axes:
            for axis in (axes.xaxis, axes.yaxis):
                formatter = axis.get_major_formatter()
                if formatter in said_of:
                    continue
                if type(formatter) is ScalarFormatter:
                    axis.set_major_formatter(Marked(useOffset=False))
                elif isinstance(formatter, FixedFormatter):
                    axis.set_major_formatter(FixedFormatter([*map(self, formatter.seq)]))
                elif isinstance(formatter, FuncFormatter):  # of ticks with given texts
                    texts = [self(one.get_text()) for one in axis.get_majorticklabels()]
                    axis.set_major_formatter(FixedFormatter(texts))
                said_of.append(axis.get_major_formatter())
        ticks = {
            id(label)
            for axes in figure.axes
            for axis in (axes.xaxis, axes.yaxis)
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())
            for label in (tick.label1, tick.label2)
        }
        for one in figure.findobj(Text):
            text = one.get_text()
            if text and id(one) not in ticks and not text.startswith("$\\math"):
                said = self(text.replace("\n", " "))
                width = max(map(len, text.split("\n")))
                one.set_text(fill(said, width) if "\n" in text else said)
