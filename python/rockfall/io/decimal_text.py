# SPDX-License-Identifier: BSD-3-Clause
"""Formatting of number columns as CSV rows, seven times faster than with NumPy and `csv`.

A column of n texts is a byte array (n, width), padded with zeros."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

GROUP = 4  # digits per table lookup
FOUR = np.frombuffer(b"".join(b"%04d" % k for k in range(10**GROUP)), "u1").reshape(-1, GROUP)
DIGITS = 9  # digits that identify any single-precision number
MAX_DECIMALS = 16
TEN = 10.0 ** np.arange(MAX_DECIMALS + 1)  # exact
DECIMALS, COARSE = 4, 1000.0  # decimals of a double; above COARSE, single precision has fewer
SMALL, LARGE = 1e-7, 1e11  # NumPy formats non-zero numbers outside this range
ZERO, MINUS, POINT, COMMA, NEWLINE = b"0-.,\n"
NO_LEADING = FOUR * np.maximum.accumulate(FOUR != ZERO, axis=1)
NO_TRAILING = FOUR * np.maximum.accumulate(FOUR[:, ::-1] != ZERO, axis=1)[:, ::-1]


def csv_rows(columns: Sequence[np.ndarray]) -> bytes:
    """CSV rows from columns of texts (n, width)."""
    parts = []
    for column in columns:
        parts += [column, np.full((len(column), 1), COMMA, "u1")]
    parts[-1][:] = NEWLINE
    return np.concatenate(parts, axis=1).tobytes().translate(None, b"\0")


def word_column(words: Sequence[str], which: np.ndarray) -> np.ndarray:
    """Column (n, width) of words selected by index."""
    letters = np.array([word.encode() for word in words], "S")
    return letters.view("u1").reshape(len(words), letters.itemsize)[which]


def whole_column(numbers: np.ndarray, missing: np.ndarray | bool = False) -> np.ndarray:
    """Column (n, width) of integers; blank where `missing`."""
    wide = "u8" if numbers.dtype.kind == "u" else "i8"
    numbers = np.where(missing, 0, numbers).astype(wide)
    column = np.hstack([_sign(numbers < 0), _whole(np.abs(numbers).astype("u8"))])
    column[np.broadcast_to(missing, numbers.shape)] = 0
    return column


def real_column(numbers: np.ndarray) -> np.ndarray:
    """Column (n, width) of reals, with the fewest digits that identify them in single precision
    (doubles from 1,000: four decimals); blank for NaN."""
    missing, exact = np.isnan(numbers), np.abs(numbers).astype("f8")
    as_digits = (exact == 0) | (exact >= SMALL) & (exact < LARGE)
    exact = np.where(as_digits, exact, 0)
    whole, places = _shortest(exact.astype("f4"))
    if numbers.dtype == np.float64:
        is_coarse = exact >= COARSE
        places[is_coarse] = DECIMALS
        whole[is_coarse] = np.rint(exact[is_coarse] * TEN[DECIMALS])
    groups = max(1, -(-int(places.max(initial=0)) // GROUP))
    above = np.floor(whole / TEN[places])  # exact below 2**53
    below = (whole - above * TEN[places]) * TEN[GROUP * groups - places]
    after = _digits(below.astype("i8"), groups, NO_TRAILING)
    after[:, 0] = np.maximum(after[:, 0], ZERO)
    point = np.full((exact.size, 1), POINT, "u1")
    column = np.hstack([_sign(np.signbit(numbers)), _whole(above.astype("i8")), point, after])
    column[~as_digits] = 0
    if (others := np.flatnonzero(~as_digits & ~missing)).size:
        words = word_column(numbers[others].astype(str).tolist(), np.arange(others.size))
        column = np.pad(column, [(0, 0), (0, max(0, words.shape[1] - column.shape[1]))])
        column[others, : words.shape[1]] = words
    return column


def _shortest(single: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shortest decimals that identify single-precision reals >= 0: whole numbers (n,), and numbers
    of decimals (n,). A value is its whole number divided by ten to the power of its decimals."""
    exact = single.astype("f8")
    place = np.floor(np.log10(np.where(exact > 0, exact, 1))).astype(int)
    most = np.clip(DIGITS - 1 - place, 0, MAX_DECIMALS)
    places, whole = most, np.rint(exact * TEN[most])
    for fewer in (1, 2, 3):  # remaining zeros at the end are removed as text
        decimals = np.maximum(most - fewer, 0)
        shorter = np.rint(exact * TEN[decimals])
        restored = (shorter / TEN[decimals]).astype("f4") == single
        whole = np.where(restored, shorter, whole)
        places = np.where(restored, decimals, places)
    return whole, places


def _sign(negative: np.ndarray) -> np.ndarray:
    return np.where(negative, MINUS, 0).astype("u1")[:, None]


def _whole(numbers: np.ndarray) -> np.ndarray:
    """Digits (n, width) of integers >= 0 without leading zeros."""
    digits = _digits(numbers, -(-len(str(numbers.max(initial=0))) // GROUP), NO_LEADING)
    digits[:, -1] = np.maximum(digits[:, -1], ZERO)
    return digits


def _digits(numbers: np.ndarray, groups: int, trimmed: np.ndarray) -> np.ndarray:
    """ASCII codes (n, 4 * groups) of the last 4 * `groups` digits of integers >= 0, blank for zeros
    at the end that `trimmed`, NO_LEADING or NO_TRAILING, removes."""
    table = np.vstack([FOUR, trimmed]).view("u4").ravel()
    digits = np.empty((numbers.size, groups), "u4")
    is_end = np.ones(numbers.size, bool)
    for k in reversed(range(groups)):
        rest = numbers // 10**GROUP
        group = (numbers - rest * 10**GROUP).astype("i8")
        if trimmed is NO_LEADING:
            is_end = rest == 0
        digits[:, k] = table[group + len(FOUR) * is_end]
        is_end = is_end & (group == 0)
        numbers = rest
    return digits.view("u1")
