# SPDX-License-Identifier: BSD-3-Clause
"""The case: the inputs of a run. The kernel reads, completes and checks it; this package gives
access to it, and writes it."""

from rockfall.case.case import (
    FROM_ARRAY,
    LINES,
    Case,
    Facts,
    case_in,
    case_of,
    check_all_kept,
    facts,
    given_groups,
    given_in_lists,
    given_text,
    in_kernel,
    is_given,
    read_case,
)
from rockfall.case.keys import (
    REPEATABLE,
    Key,
    broken_rule,
    default_values,
    file_keys,
    key_table,
    keys_of,
    varied_key,
)
