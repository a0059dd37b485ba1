# SPDX-License-Identifier: BSD-3-Clause
"""Rebound models: grounds and their table, impact sets, tables of impacts."""

from rockfall.grounds.grounds import (
    ABSORBS,
    BLOCK_TABLE,
    IMPACT_SETS,
    RATIO_TABLE,
    TABLES,
    GroundRule,
    GroundTable,
    block_axes,
    block_radius,
    check_number,
    ensemble_grounds,
    find_ground,
    find_operator,
    grounds_by_shape,
    models,
    other_tables,
    parameters,
    repose,
    shipped_grounds,
    table_path,
    usual_ground,
    usual_key,
    usual_name,
)
