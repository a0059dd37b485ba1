# SPDX-License-Identifier: BSD-3-Clause
"""Columns of numbers as text: equal to those of Python and NumPy."""

import numpy as np
import pytest

from rockfall.io.decimal_text import csv_rows, real_column, whole_column, word_column

random = np.random.default_rng(5)
CLOSE = [0.0, -0.0, 1.0, 0.1, 0.5, 2.5, 100.0, 9.9999, 1e-4, 999999.94]


def texts(column):
    return csv_rows([column]).decode().splitlines()


def test_singles_have_the_fewest_digits_that_restore_them():
    values = np.append(CLOSE, random.normal(size=5000) * 10.0 ** random.uniform(-3, 4, 5000))
    values = values.astype("f4")
    values = values[(values == 0) | (np.abs(values) > 1.1e-4)]  # NumPy writes 1e-04
    assert texts(real_column(values)) == [str(value) for value in values]
    few = values[np.abs(values) < 1000].astype("f8")
    assert texts(real_column(few)) == [str(value) for value in few.astype("f4")]


@pytest.mark.parametrize("power", [-44, -40, -17, -9, -8, -7, -6, 7, 10, 11, 12, 18, 30, 38])
def test_small_and_large_singles_are_restored(power):
    values = (random.uniform(1, 3, 500) * 10.0**power).astype("f4")
    values[::2] *= -1
    written = np.array(texts(real_column(values)), float).astype("f4")
    assert (written == values).all() and (values != 0).all()


def test_one_small_or_large_number_leaves_the_rest_of_its_column_alone():
    values = np.array([2600123.4567, -2600123.4567, 0.25, -0.0, np.nan])
    plain = texts(real_column(values))
    for odd, text in [(np.inf, "inf"), (-1e300, "-1e+300"), (1e-40, "1e-40"), (-2e-9, "-2e-09")]:
        assert texts(real_column(np.append(values, odd))) == [*plain, text]


def test_doubles_have_four_decimals_where_single_precision_is_coarser():
    values = np.append([1000.0, 1394.357421875, 1e6], 2.6e6 + random.normal(size=2000) * 1e5)
    assert texts(real_column(values)) == [repr(v) for v in np.round(values, 4).tolist()]


@pytest.mark.parametrize("most", [1, 9, 10, 9999, 10_000, 2**31, 10**17])
def test_integers(most):
    values = np.append([0, most, -most], random.integers(-most, most, 500))
    assert texts(whole_column(values)) == [str(value) for value in values.tolist()]


@pytest.mark.parametrize("kind", ["i1", "i2", "i4", "i8", "u1", "u4", "u8"])
def test_the_ends_of_each_kind_of_integers(kind):
    limits = np.iinfo(kind)
    values = np.array([limits.min, limits.max, 0], kind)
    assert texts(whole_column(values)) == [str(value) for value in values.tolist()]


def test_missing_values_are_empty_and_words_stay_whole():
    columns = [
        word_column(["rest", "gebüsch"], np.array([1, 0, 1])),
        whole_column(np.array([7, -1, 123456]), np.array([False, True, False])),
        real_column(np.array([np.nan, 1.5, np.inf])),
    ]
    assert csv_rows(columns).decode() == "gebüsch,7,\nrest,,1.5\ngebüsch,123456,inf\n"
    none = np.zeros(0, int)
    empty = [word_column([], none), whole_column(none), real_column(np.zeros(0))]
    assert csv_rows(empty) == b""
