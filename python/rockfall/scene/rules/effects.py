# SPDX-License-Identifier: BSD-3-Clause
"""Checks for keys without effect because of a case's files; the kernel checks the case itself."""

from rockfall.case import given_groups
from rockfall.case.text import literal
from rockfall.errors import RockfallError
from rockfall.grounds import IMPACT_SETS, RATIO_TABLE, TABLES
from rockfall.scene.rules.boulders import largest_volumes
from rockfall.scene.scene import Scene


def check_effects(scene: Scene) -> None:
    """Raise a RockfallError for rebound keys that no ground uses, and for a minimum fragment larger
    than every boulder."""
    case = scene.case
    given = given_groups(case)
    models = {ground.model for ground in scene.grounds} or {IMPACT_SETS}
    for group, key, is_used, with_ in (
        ("impact", "ratio", IMPACT_SETS in models, "impact sets"),
        ("impact", "turning", not models <= {*TABLES}, "impact sets or classical models"),
        ("boulder", "block_shape", not models.isdisjoint(TABLES), "an impact table"),
        ("boulder", "mean_radius_sigma", bool(models & {IMPACT_SETS, RATIO_TABLE}), "impact sets"),
        ("boulder", "block_shape_share", not models.isdisjoint(TABLES), "an impact table"),
    ):
        value = given.get(group, {}).get(key)
        if not is_used and value is not None:
            raise RockfallError(
                f"{case.name}: &{group} {key} = {literal(value)}: is only valid with {with_}, "
                "which no ground has"
            )
    least = case.breakage["min_volume"]
    if case.breakage["at"] != "none" and least >= max(largest_volumes(scene)):
        raise RockfallError(
            f"{case.name}: &breakage min_volume = {least:g}: must be below the largest volume of "
            "the boulders [m3], or no boulder breaks"
        )
