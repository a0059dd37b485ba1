# SPDX-License-Identifier: BSD-3-Clause
"""Removal of stems: near sources, and by felling or a storm.

Removal depends only on a stem's position and its own random number. The remaining stems are thus a
subset of the stems that remain after a weaker thinning, so that variants of a forest share trees.
"""

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import read_polygons
from rockfall.io.vectors.polygons import points_inside
from rockfall.language import remark
from rockfall.scene.forest.attributes import Attributes
from rockfall.scene.forest.trees import Planted
from rockfall.scene.layers import Inputs


def is_thinned(case: Case) -> bool:
    """Return True if clearings or a density factor remove stems."""
    return "clearings" in case.forest or case.forest["density_factor"] < 1


def numbers_of_list(case: Case, n: int) -> np.ndarray | None:
    """Random number of each of `n` listed trees, which decides whether it remains; None without
    thinning."""
    if not is_thinned(case):
        return None
    return _core.stand_numbers(case.forest["seed"], n, 1, np.ones(n, "i4"), 2, n)[1]


def thinned(inputs: Inputs, planted: Planted, x: np.ndarray, y: np.ndarray) -> Planted:
    """Remove stems near the sources at `x`, `y` [m], and by thinning; return the others. Raises a
    RockfallError if none remains."""
    forest, trees = inputs.case.forest, planted.trees
    remain = np.ones(trees.x.size, bool)
    if forest["clear_of_sources"] > 0:
        from scipy.spatial import KDTree

        sources = KDTree(np.column_stack((x, y)))
        nearest, _ = sources.query(
            np.column_stack((trees.x, trees.y)), distance_upper_bound=forest["clear_of_sources"]
        )
        remain &= np.isinf(nearest)
    if planted.remain is not None:
        remain &= planted.remain < forest["density_factor"] * _cleared(inputs, trees.x, trees.y)
    if remain.all():
        return planted
    if not remain.any():
        raise RockfallError(
            f"{inputs.case.name}: &forest: no stem remains of {remain.size:,}: leave out &forest "
            "to run without trees"
        )
    stand = None if planted.stand is None else planted.stand[remain]
    return Planted(trees.select(remain), None, stand)


def _cleared(inputs: Inputs, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Fraction of stems that remain after clearing; where clearings overlap, the smallest. Refuses
    clearings without stems."""
    forest, factors = inputs.case.forest, np.ones(x.size)
    if "clearings" not in forest:
        return factors
    path, layer = inputs.case.path(forest["clearings"]), forest.get("clearings_layer")
    shapes, columns = read_polygons(path, inputs.grid, inputs.remarks, layer, "clearings_layer")
    inputs.note_layer("clearings", path, layer)
    attributes = Attributes(str(path), columns)
    attributes.note_unused(inputs.remarks, ("density_factor", "name"))
    given = attributes.numbers("density_factor", np.ones(shapes.size, bool))
    remaining, stems = np.zeros(shapes.size) if given is None else given, np.zeros(shapes.size, int)
    for k, inside in points_inside(shapes, x, y):
        factors[inside] = np.minimum(factors[inside], remaining[k])
        stems[k] = inside.size
    if not stems.any():
        raise RockfallError(f"{path}: no stem is in a polygon of the clearings")
    if empty := int(np.count_nonzero(stems == 0)):
        numbers = {"part": empty, "n": stems.size}
        inputs.remarks.append(remark(path, "input.clearings_empty", **numbers))
    return factors
