# SPDX-License-Identifier: BSD-3-Clause
"""Scenes of a case for each rebound model; only their grounds differ."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from rockfall.case import Case
from rockfall.case.zones import case_zones
from rockfall.errors import RockfallError
from rockfall.grounds import (
    ABSORBS,
    IMPACT_SETS,
    NO_GROUND,
    RATIO_TABLE,
    TABLES,
    GroundRule,
    GroundTable,
    find_ground,
    named_ground,
    shipped_grounds,
    table_names,
    table_path,
    usual_ground,
    usual_name,
)
from rockfall.io.zone_table import NamedGround
from rockfall.language import say
from rockfall.quantities import percent
from rockfall.scene.parts import Rasters
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.scene.surface import radius_over_rg

#: Obstacle size [m] that separates the soil types 3 (scree) and 4 (talus) of Rockyfor3D.
LARGE = 0.1
#: Shipped grounds for rocks below and above `LARGE`, by model.
ROCKS = {
    "rockyfor3d": ("soil_3", "soil_4"),
    "pfeiffer_bowen": ("pfeiffer_talus", "pfeiffer_rock"),
    "constant": ("constant_talus", "rock_ledge"),
    "bourrier_hungr": ("bourrier_hungr", "bourrier_hungr"),
}
#: Keys that only impact tables use.
OF_TABLES = ("block_shape", "block_shape_share", "block_axes", "ground_strength_sigma")
#: Obstacle size [m] that stops all boulders in Rockyfor3D, but not with impact sets.
STOPPING = 100.0
SECOND = "talus"  # impact table that replaces impact sets
BY_SETS = "impact sets, method "  # start of a model name, before the method
CONSTANT = "constant_"  # start of the names of grounds with constant coefficients
BY_NAME = " by name"  # end of the name of the case's ground where zones name it
AS_GIVEN = "grounds of the case"


def variants(case: Case, grounds: Sequence[str], notes: list[str]) -> Iterator[tuple[str, Scene]]:
    """Scenes by model name, the unchanged scene first; remarks are added to `notes`. Raises a
    RockfallError if all ground absorbs boulders."""
    as_given = read_scene(case)
    own = _with_named_apart(as_given)
    table = GroundTable(table_path(case))
    chosen = [find_ground(case, table, name, "--ground") for name in grounds]
    varied = _varied(own)
    if not _on_grounds(own, varied).any():
        raise RockfallError(f"{case.name}: all of its ground absorbs boulders, so all models agree")
    if not _own_share(own):
        yield AS_GIVEN, as_given
        yield from _by_sets(own, varied, notes)
    else:
        yield from _by_methods(case, as_given)
    unsized = _unsized_part(own, varied)
    if chosen:
        notes += _unsized_notes(case, "--ground", chosen, unsized)
        yield from ((rule.name, with_rocks(own, rule, rule, varied)) for rule in chosen)
        return
    shipped = GroundTable(shipped_grounds())
    rocks = {
        model: (shipped.ground(small, case), shipped.ground(large, case))
        for model, (small, large) in ROCKS.items()
    }
    if 0 < unsized < 1:
        notes.append(say("models.unsized_part", fraction=percent(unsized), size=LARGE))
    if unsized < 1:
        yield from ((model, with_rocks(own, *rules, varied)) for model, rules in rocks.items())
        return
    needing = [model for model, rules in rocks.items() if any(rule.rocks for rule in rules)]
    notes.append(say("models.unsized", models=", ".join(needing), size=LARGE))
    for model, rules in rocks.items():
        if model not in needing:
            for rule in dict.fromkeys(rules):
                yield f"{model} {rule.name}", with_rocks(own, rule, rule, varied)


def by_tables(
    case: Case, own: Scene, names: Sequence[str] | None, notes: list[str]
) -> Iterator[tuple[str, Scene]]:
    """Scenes of a case in which each impact table of `names` (default: all shipped tables with
    known rock sizes) replaces the grounds that `variants` varies; the case's own table is left out.
    `own` is the scene of the case; remarks are added to `notes`."""
    own = _with_named_apart(own)
    varied, is_named = _varied(own), not _own_share(own)
    follows_table = case.impact["form"] == "table" or "ground" in case.surface
    kept = _kept_models(own)
    unused: dict[str, Any] = {} if IMPACT_SETS in kept else {"ratio": None}
    if kept <= {*TABLES}:
        unused["turning"] = None
    laws, unsized = {}, _unsized_part(own, varied)
    for name in table_names() if names is None else names:
        by_table = {"form": "table", "table": name}
        if is_named or not follows_table or name != usual_name(case):
            law = case.replace(impact=unused | by_table, surface=NO_GROUND)
            rule = usual_ground(law)
            if not {rule.model, *kept} & {IMPACT_SETS, RATIO_TABLE}:
                law = law.replace(boulder={"mean_radius_sigma": None})
            laws[name] = law, rule
    needing = [rule.name for _, rule in laws.values() if rule.rocks]
    if names is None and unsized == 1 and needing:
        laws = {name: law for name, law in laws.items() if name not in needing}
        notes.append(say("models.unsized_tables", tables=", ".join(needing)))
    notes += _unsized_notes(case, "--table", [rule for _, rule in laws.values()], unsized)
    keeps_grounds = _grounds_of(own.rasters).ndim > 0
    for name, (law, rule) in laws.items():
        by_table = with_rocks(own, rule, rule, varied) if keeps_grounds else read_scene(law)
        yield f"table {name}", by_table


def second_model(own: Scene) -> tuple[str, Scene] | None:
    """Name and scene of another model for the ground of a scene. Impact sets replace tables and
    classical grounds if rocks have a suitable size, otherwise constant coefficients of the same
    ground replace tables; the table `talus` replaces impact sets and ratio tables. None if no model
    is possible."""
    own = _with_named_apart(own)
    varied = _varied(own)
    if not _on_grounds(own, varied).any():
        return None
    models = {ground.model for ground in own.grounds if ground.name in varied} or {IMPACT_SETS}
    if not models & {IMPACT_SETS, RATIO_TABLE}:
        return next(_by_sets(own, varied, []), None) or _by_constants(own, varied)
    rule = find_ground(own.case, GroundTable(table_path(own.case)), SECOND, "second model")
    if _unsized_part(own, varied) > 0:
        return None
    return rule.name, with_rocks(own, rule, rule, varied)


def _by_constants(own: Scene, varied: Collection[str]) -> tuple[str, Scene] | None:
    """Names of the shipped grounds with constant coefficients that replace grounds of the same
    name, and the scene; None if no ground has one."""
    shipped, changed = GroundTable(shipped_grounds()), {}
    for ground in own.grounds:
        name = CONSTANT + ground.name.removesuffix(BY_NAME)
        if ground.name in varied and ground.model in TABLES and name in shipped.rows:
            rule = shipped.ground(name, own.case)
            changed[ground.name] = rule._replace(name=CONSTANT + ground.name)
    if not changed:
        return None
    grounds = tuple(changed.get(ground.name, ground) for ground in own.grounds)
    names = dict.fromkeys(rule.name.removesuffix(BY_NAME) for rule in changed.values())
    return ", ".join(names), own.replace(grounds=grounds)


def _unsized_notes(
    case: Case, option: str, rules: Iterable[GroundRule], unsized: float
) -> Iterator[str]:
    """Remark on `rules` that need rock sizes, if a part `unsized` of the terrain has none; raises a
    RockfallError if the whole terrain has none."""
    needing = [rule.name for rule in rules if rule.rocks]
    if unsized == 1 and needing:
        raise RockfallError(f"{case.name}: {option} {needing[0]}: requires rock sizes in &surface")
    if unsized > 0 and needing:
        yield say("models.unsized_smooth", fraction=percent(unsized), models=", ".join(needing))


def named_notes(own: Scene) -> Iterator[str]:
    """Remark on the part of the terrain where all models have the same ground, or on the grounds
    that vary if every place has a named ground."""
    own = _with_named_apart(own)
    if not (share := _own_share(own)):
        part = _on_grounds(own, _varied(own))[~np.isnan(own.rasters.z)].mean()
        yield say("models.all_named", fraction=percent(part))
    elif share < 1:
        yield say("models.named_grounds", fraction=percent(1 - share))


def _kept_models(own: Scene) -> set[str]:
    """Models of the grounds that are the same in all scenes."""
    varied = _varied(own)
    return {ground.model for ground in own.grounds if ground.name not in varied}


def _varied(own: Scene) -> set[str]:
    """Names of the grounds that models replace: the default ground or, if every place has a named
    ground, all grounds that do not absorb boulders."""
    if _own_share(own):
        return {usual_name(own.case)}
    return {ground.name for ground in own.grounds if ground.model != ABSORBS}


def _by_methods(case: Case, own: Scene) -> Iterator[tuple[str, Scene]]:
    """Scenes of the unchanged case, and of its impact sets by each method with known sizes."""
    if "ground" in case.surface:
        yield usual_name(case), own
    elif case.impact["form"] == "table":
        yield f"table {usual_name(case)}", own
    method = case.surface["method"]
    named = {str(zone.ground_in(NamedGround(""))) for zone in case_zones(case).values()}
    tables = {ground.name for ground in own.grounds if ground.model in TABLES}
    unused = {} if named & tables else dict.fromkeys(OF_TABLES)  # not allowed without a table
    for way in (method, "AB".replace(method, "")):
        surface = {**NO_GROUND, "method": way}
        try:
            scene = read_scene(
                case.replace(impact={"form": "matrix"}, surface=surface, boulder=unused)
            )
        except RockfallError:  # sizes for this method are missing
            continue
        yield f"{BY_SETS}{way}", scene


def _by_sets(own: Scene, varied: Collection[str], notes: list[str]) -> Iterator[tuple[str, Scene]]:
    """Scene with impact sets instead of grounds wherever rocks have a suitable size. Ground with
    obstacles that stop all boulders, and smooth ground, remain unchanged."""
    cells, rule = own.rasters, GroundRule(own.case.impact["sets"])
    names = [ground.name for ground in own.grounds]
    grounds = own.grounds if rule.name in names else (*own.grounds, rule)
    number = [rule.name for rule in grounds].index(rule.name) + 1
    fits = _test_sizes(cells, lambda sizes: np.all((sizes > 0) & (sizes < STOPPING), axis=0))
    changed = _on_grounds(own, varied) & fits
    if not changed.any():
        notes.append(say("models.no_sizes"))
        return
    if (part := changed[~np.isnan(cells.z)].mean()) < 1:
        notes.append(say("models.sets_on_part", fraction=percent(part)))
    of_cells = np.where(changed, np.int8(number), _grounds_of(cells)).astype(np.int8)
    name = f"{BY_SETS}{own.case.surface['method']}"
    yield name, own.replace(grounds=grounds, material_ground=None, cell_ground=of_cells)


def _with_named_apart(scene: Scene) -> Scene:
    """Scene in which zones that name the case's ground get a renamed copy of it, which stays
    unchanged when models vary the case's ground."""
    usual = named_ground(scene.case)
    own, zones = str(usual), case_zones(scene.case).values()
    named = np.array([zone.ground and str(zone.ground_in(usual)) == own for zone in zones], bool)
    of_zones = scene.rasters.material_ground
    if of_zones is None or not named.any():
        return scene
    (rule,) = (ground for ground in scene.grounds if ground.name == own)
    grounds = *scene.grounds, rule._replace(name=f"{own}{BY_NAME}")
    numbers = np.where(named, len(grounds), of_zones).astype(np.int8)
    return scene.replace(grounds=grounds, material_ground=numbers)


def _own_share(scene: Scene) -> float:
    """Fraction of the terrain with the case's default ground [-]."""
    return float(_on_grounds(scene, {usual_name(scene.case)})[~np.isnan(scene.rasters.z)].mean())


def _unsized_part(scene: Scene, varied: Collection[str]) -> float:
    """Fraction of the terrain with `varied` grounds that lacks rock sizes [-]."""
    unsized = _test_sizes(scene.rasters, lambda sizes: sizes[0] == 0)
    here = _on_grounds(scene, varied)
    return float(np.broadcast_to(unsized, here.shape)[here].mean()) if here.any() else 0.0


def _on_grounds(scene: Scene, names: Collection[str]) -> np.ndarray:
    """Mask of terrain cells whose ground is in `names`."""
    grounds = [ground.name for ground in scene.grounds] or [usual_name(scene.case)]
    listed = np.array([False, *(name in names for name in grounds)])
    return listed[_grounds_of(scene.rasters)] & ~np.isnan(scene.rasters.z)


def _grounds_of(cells: Rasters) -> np.ndarray:
    """Ground number of each cell, from 1; a single number if all are equal."""
    if cells.cell_ground is not None:
        return cells.cell_ground
    if cells.material_ground is None:
        return np.ones((), np.int8)
    return np.append(np.int8(0), cells.material_ground)[1 if cells.zone is None else cells.zone]


def _test_sizes(cells: Rasters, test: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Apply a test to rock sizes (columns, ...), by cell or uniform."""
    if cells.values is not None:
        return test(cells.values)
    return np.append(False, test(cells.sizes.T))[1 if cells.zone is None else cells.zone]


def with_rocks(
    scene: Scene, small: GroundRule, large: GroundRule, varied: Collection[str] = ()
) -> Scene:
    """Scene in which grounds for small and large rocks replace the `varied` grounds (default: the
    case's default ground)."""
    cells = scene.rasters
    varied = varied or {usual_name(scene.case)}
    others = [ground for ground in scene.grounds if ground.name not in varied]
    rules = dict.fromkeys((small, large))
    number = {rule.name: k for k, rule in enumerate([*rules, *others], start=1)}
    names = [ground.name for ground in scene.grounds] or [usual_name(scene.case)]
    kept = np.array([0, *(0 if name in varied else number[name] for name in names)], np.int8)
    sizes = cells.sizes[:, 0] if cells.values is None else cells.values[0]
    of_rocks = _choice(scene, sizes, number[small.name], number[large.name])
    everywhere, of_materials, of_cells = None, None, None
    if cells.values is not None or cells.cell_ground is not None:
        zone = np.ones((), int) if cells.zone is None else cells.zone
        here = np.append(np.int8(1), of_rocks)[zone] if cells.values is None else of_rocks
        of_cells = _filled(kept[1 if cells.cell_ground is None else cells.cell_ground], here)
        of_cells = np.broadcast_to(of_cells, cells.z.shape).copy()
    elif cells.zone is not None:
        ground = 1 if cells.material_ground is None else cells.material_ground
        of_materials = _filled(kept[ground], of_rocks)
    else:
        everywhere = (large if of_rocks[0] == number[large.name] else small,)
    return scene.replace(
        grounds=everywhere or (*rules, *others), material_ground=of_materials, cell_ground=of_cells,
    )  # fmt: skip


def _filled(numbers: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Ground numbers in which other numbers replace zeros."""
    return np.where(numbers, numbers, others).astype(np.int8)


def _choice(scene: Scene, sizes: np.ndarray, small: int, large: int) -> np.ndarray:
    """Ground number, `small` or `large`, by rock size; the limit is an Rg, as in Rockyfor3D."""
    obstacles = sizes if scene.case.surface["method"] == "A" else sizes / radius_over_rg(scene.case)
    return np.where(obstacles >= LARGE, np.int8(large), np.int8(small))
