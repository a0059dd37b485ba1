# SPDX-License-Identifier: BSD-3-Clause
"""Warnings are errors in all tests, including those of the laboratory."""

#: Warnings that do not fail tests: UserWarning, which some tests expect, and those of libraries.
HARMLESS = (
    "ignore::UserWarning",
    "ignore::ResourceWarning",
    *(  # warnings of libraries about each other's versions
        f"ignore::{kind}:(?!rockfall|test|lab|benchmarks)"
        for kind in ("DeprecationWarning", "PendingDeprecationWarning", "FutureWarning")
    ),
    "ignore:Use `@` matmul:PendingDeprecationWarning",
    "ignore:Normalized/laundered field name:RuntimeWarning",
    "ignore:The 'float_precision' argument",
    "ignore:It looks like `register_random`",
)


def pytest_configure(config):
    for line in ("error", *HARMLESS):
        config.addinivalue_line("filterwarnings", line)
