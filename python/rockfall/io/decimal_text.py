# SPDX-License-Identifier: BSD-3-Clause
"""Formatting of number columns as CSV rows, seven times faster than with NumPy and `csv`.

A column of n texts is a byte array (n, width), padded with zeros."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

GROUP = 4  # digits per table lookup
FOUR = np.frombuffer(b"".join(b"%04d" % k for k in range(10**GROUP)), "u4")
DIGITS = 9  # digits that identify any single-precision number
MAX_DECIMALS = 16
TEN = 10 ** np.arange(MAX_DECIMALS + 1)
DECIMALS, COARSE = 4, 1000.0  # decimals of a double; above COARSE, single precision has fewer
SMALL, LARGE = 1e-7, 1e11  # NumPy formats non-zero numbers outside this range
ZERO, MINUS, POINT, COMMA, NEWLINE = b"0-.,\n"


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
    above = whole // TEN[places]
    below = (whole - above * TEN[places]) * TEN[GROUP * groups - places]
    after = _digits(below, groups)
    zeros = np.where(below == 0, GROUP * groups - 1, np.argmax(after[:, ::-1] != ZERO, axis=1))
    after *= _up_to(GROUP * groups)[::-1] >= zeros.astype("u1")[:, None]
    point = np.full((exact.size, 1), POINT, "u1")
    column = np.hstack([_sign(np.signbit(numbers)), _whole(above), point, after])
    column[~as_digits] = 0
    if (others := np.flatnonzero(~as_digits & ~missing)).size:
        words = word_column(numbers[others].astype(str).tolist(), np.arange(others.size))
        column = np.pad(column, [(0, 0), (0, max(0, words.shape[1] - column.shape[1]))])
        column[others, : words.shape[1]] = words
    return column


def _shortest(single: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shortest decimals that identify single-precision reals >= 0: integers (n,), and numbers of
    decimals (n,). A value is its integer divided by ten to the power of its number of decimals."""
    exact = single.astype("f8")
    place = np.floor(np.log10(np.where(exact > 0, exact, 1))).astype(int)
    places = np.clip(DIGITS - 1 - place, 0, MAX_DECIMALS)
    whole = np.rint(exact * TEN[places])
    for fewer in (1, 2, 3):  # remove trailing zeros
        scale = TEN[np.maximum(places - fewer, 0)]
        shorter = np.rint(exact * scale)
        restored = (shorter / scale).astype("f4") == single
        whole = np.where(restored, shorter * (TEN[places] // scale), whole)
    return whole.astype("i8"), places


def _sign(negative: np.ndarray) -> np.ndarray:
    return np.where(negative, MINUS, 0).astype("u1")[:, None]


def _whole(numbers: np.ndarray) -> np.ndarray:
    """Digits (n, width) of integers >= 0 without leading zeros."""
    digits = _digits(numbers, -(-len(str(numbers.max(initial=0))) // GROUP))
    first = np.where(numbers == 0, digits.shape[1] - 1, np.argmax(digits != ZERO, axis=1))
    digits *= _up_to(digits.shape[1]) >= first.astype("u1")[:, None]
    return digits


def _up_to(width: int) -> np.ndarray:
    return np.arange(width, dtype="u1")


def _digits(numbers: np.ndarray, groups: int) -> np.ndarray:
    """ASCII codes (n, 4 * groups) of the last 4 * `groups` digits of integers >= 0."""
    digits = np.empty((numbers.size, groups), "u4")
    for k in reversed(range(groups)):
        rest = numbers // 10**GROUP
        digits[:, k] = FOUR[numbers - rest * 10**GROUP]
        numbers = rest
    return digits.view("u1")
