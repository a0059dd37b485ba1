# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of names to words for files and flags."""

import re
import unicodedata
from collections.abc import Iterable


def distinct_words(names: Iterable[str], only_ascii: bool = False) -> list[str]:
    """Convert names to unique words of letters, digits and a few marks, valid in file names and
    (with `only_ascii`) in CF's flag_meanings."""
    words: list[str] = []
    taken: set[str] = set()
    for name in names:
        if only_ascii:
            name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
        word = stem = re.sub(r"[^\w.+-]+", "_", name).strip("._") or "line"
        count = 1
        while word.lower() in taken:
            count += 1
            word = f"{stem}_{count}"
        taken.add(word.lower())
        words.append(word)
    return words
