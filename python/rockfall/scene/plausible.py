# SPDX-License-Identifier: BSD-3-Clause
"""What a scene may have, but hardly ever means: a line for each, which says what it would mean.

What is impossible is refused where it is read. The limits are far from what is usual: a warning of
a sound scene does harm, too. Each limit stands once, with its reason, in `rockfall.scene.rules`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

from rockfall.scene.rules.boulders import boulder_rules
from rockfall.scene.rules.protection import protection_rules
from rockfall.scene.rules.terrain import dem_rules
from rockfall.scene.scene import InputWarning, Scene, lines_outside


def input_warnings(scene: Scene) -> list[InputWarning]:
    """Each thing that is likely a mistake; found once for a scene, and for those made from it."""
    if scene.warnings is None:
        found = (one for rule in RULES for one in rule(scene))
        scene.warnings = list(dict.fromkeys(found))
    return scene.warnings


def implausible(scene: Scene) -> list[str]:
    """A line for each thing that is likely a mistake."""
    return [f"{scene.case.name}: {where}: {text}" for where, text in input_warnings(scene)]


def warn_of(scene: Scene) -> None:
    """The lines as warnings of Python, to the caller of the caller."""
    for line in implausible(scene):
        warnings.warn(line, stacklevel=3)


def _lines(scene: Scene) -> Iterator[InputWarning]:
    barriers = {one["name"] for one in scene.case.barrier}
    for name in lines_outside(scene):
        group = "barrier" if name in barriers else "line"
        yield InputWarning(f"&{group} name = '{name}'", "no part of it lies over the terrain")


def _read(scene: Scene) -> Iterator[InputWarning]:
    """What readers found odd: a place, and what is odd there."""
    for remark in scene.remarks:
        where, _, text = remark.partition(": ")
        yield InputWarning(where, text)


RULES = _lines, dem_rules, boulder_rules, protection_rules, _read
