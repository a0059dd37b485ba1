# SPDX-License-Identifier: BSD-3-Clause
"""Import of a three-dimensional PlatRock simulation, with the defaults of PlatRock 0.4.6."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.case.text import Entry, Group
from rockfall.errors import RockfallError, need
from rockfall.files.export import write_geopackage
from rockfall.importers.imported import CASE, Import, only, tree_rows
from rockfall.io.atomic import atomic_folder
from rockfall.io.coordinates.crs import plan_wkt
from rockfall.io.rasters.grid import NO_ID
from rockfall.io.tables import decimal
from rockfall.io.vectors.layers import burn_polygons, plain, read_features
from rockfall.scene.rebounds.kernel_rebounds import sphere_radius

ROCKS, SOILS, FOREST, CHECKPOINTS = "rocks", "soils", "forest", "checkpoints"
SOURCES, ZONES, STANDS, LINES = "sources.gpkg", "soils.tif", "stands.gpkg", "checkpoints.gpkg"
GROUNDS, TREES = "grounds.csv", "trees.csv"


class Key(NamedTuple):
    """A PlatRock attribute: its names, default and allowed values."""

    names: tuple[str, ...]
    default: float
    minimum: float = 0.0
    positive: bool = False  # True if zero is not allowed


#: Attributes by kind of layer; names are case-sensitive, as in PlatRock.
KEYS = {
    ROCKS: {
        "number": Key(("number", "rocks_nb", "nb_rocks"), 10, 1),
        "z": Key(("rocks_z", "z"), 4),
        "rocks_min_vol": Key(("rocks_min_vol",), 0.2, positive=True),
        "rocks_max_vol": Key(("rocks_max_vol",), 1, positive=True),
        "density": Key(("rocks_density", "density"), 2650, positive=True),
        "vz": Key(("rocks_vz", "vz"), 0, -math.inf),
    },
    SOILS: {
        "bounce_model_number": Key(("bounce_model_number", "bounce_mod"), 0),
        "roughness": Key(("roughness",), 0.1),
        "R_n": Key(("R_n",), 0.15),
        "R_t": Key(("R_t",), 0.05),
        "v_half": Key(("v_half",), 10, positive=True),
        "phi": Key(("phi",), 20),
    },
    FOREST: {
        "stems": Key(("trees_density", "density"), 200),
        "dbh_mean": Key(("trees_dhp_mean", "dhp_mean"), 30, positive=True),
        "dbh_std": Key(("trees_dhp_std", "dhp_std"), 10),
    },
}  # fmt: skip
WITHOUT_EFFECT = {"mu_r": "has no effect in three dimensions"}
#: Ground of terrain without a soil: PlatRock's `Terrain` ignores its own defaults.
OUTSIDE = {name: key.default for name, key in KEYS[SOILS].items()}
MODELS = ("constant", "pfeiffer_bowen", "bourrier_hungr")  # sorted by PlatRock's numbers
NEEDED = (
    ("R_n", "R_t"),
    ("R_n", "R_t"),
    ("v_half", "R_t", "phi"),
)  # attributes that each of MODELS needs
OURS = {"R_n": "r_n", "R_t": "r_t", "v_half": "half_speed", "phi": "friction_angle"}
GRAVITY, STOP_SPEED = 9.8, 0.2  # [m/s2], [m/s]
MAPS = ["passages", "deposits", "energy_q95", "jump_height_q95"]


@dataclass
class Layer:
    """Features of a GeoJSON file, with PlatRock's attribute names."""

    path: Path
    shapes: np.ndarray
    columns: dict[str, np.ndarray]

    @property
    def kind(self) -> str:
        """Use of the layer; "" if PlatRock would find nothing in it. Refuses attributes of two
        layers."""
        shapes = {shape.geom_type.removeprefix("Multi") for shape in self.shapes}
        if shapes == {"LineString"}:
            return CHECKPOINTS
        if shapes != {"Polygon"}:
            return ""
        hits = {
            kind: sum(name in self.columns for key in keys.values() for name in key.names)
            for kind, keys in KEYS.items()
        }
        best = max(hits, key=lambda kind: hits[kind])
        if list(hits.values()).count(hits[best]) > 1 and hits[best]:
            raise RockfallError(
                f"{self.path}: has attributes of {best} and of another layer: rocks, soils and "
                "forest require separate files"
            )
        return best if hits[best] else ""

    def values(self, made: Import, kind: str) -> dict[str, list[float]]:
        """Values of all features by key; defaults are noted if they have an effect."""
        own = {name for key in KEYS[kind].values() for name in key.names}
        for name in self.columns.keys() - own - {"name"}:
            why = WITHOUT_EFFECT.get(name, "is not an attribute of PlatRock here")
            made.left.append(f"{made.name(self.path)}: {name} {why}")
        values = {name: self._numbers(name, key) for name, key in KEYS[kind].items()}
        models = [int(number) for number in values.get("bounce_model_number", ())]
        for name, key in KEYS[kind].items():
            lacking = [
                k
                for k, value in enumerate(self._given(key), start=1)
                if value is None
                and (name not in OURS or name in dict(enumerate(NEEDED)).get(models[k - 1], ()))
            ]
            if lacking:
                which = f"polygon {', '.join(map(str, lacking))}"
                made.changed.append(
                    f"{made.name(self.path)}: {which}: no {name}: {key.default:g}, PlatRock's "
                    "default"
                )
        return values

    def _given(self, key: Key) -> list[Any]:
        """Values of an attribute; None for missing values. Refuses two names of an attribute."""
        names = [name for name in key.names if name in self.columns]
        if len(names) > 1:
            raise RockfallError(
                f"{self.path}: has {' and '.join(names)}, which are the same attribute: keep one "
                "of them"
            )
        return [*map(plain, self.columns[names[0]])] if names else [None] * len(self.shapes)

    def _numbers(self, name: str, key: Key) -> list[float]:
        return [
            float(key.default) if value is None else self._number(k, name, value, key)
            for k, value in enumerate(self._given(key), start=1)
        ]

    def _number(self, k: int, name: str, value: Any, key: Key) -> float:
        number = decimal(value) if isinstance(value, str) else float(value)
        wrong = not math.isfinite(number) or number < key.minimum
        if wrong or (key.positive and number == 0):
            least = f"{'>' if key.positive else '>='} {key.minimum:g}"
            rule = f"a number {least}" if math.isfinite(key.minimum) else "a number"
            raise RockfallError(f"{self.path}: polygon {k}: {name} = {value!r}: must be {rule}")
        return number

    def names(self, prefix: str, first: int = 1) -> list[str]:
        """Names of the features if all differ, else numbers."""
        own = [plain(value) for value in self.columns.get("name", ())]
        if own and None not in own and len(set(map(str, own))) == len(own):
            return [*map(str, own)]
        return [f"{prefix} {k}" for k in range(first, first + len(self.shapes))]


def import_platrock(
    directory: str | Path, out: str | Path, *, crs: str | None = None
) -> dict[str, list[str]]:
    """Write a case to the folder `out`, from the layers of a three-dimensional PlatRock simulation.

    Uses a DEM (.asc, .tif), GeoJSON layers of rocks, soils, forest and checkpoints (recognised by
    attributes), and trees (.xyd). `crs` (such as EPSG:2154) is the CRS of all layers, because
    PlatRock ignores CRSs.

    Returns lines about the inputs by heading: "taken over", "imported with changes" and "not
    imported". Raises a RockfallError for an input that cannot be used.

    >>> import rockfall
    >>> lines = rockfall.import_platrock("simulation", "imported", crs="EPSG:2154")
    >>> lines["taken over"][0]
    'dem.asc: the terrain'
    """
    need("layers need", "vector")
    folder, out = Path(directory), Path(out)
    if not folder.is_dir():
        raise RockfallError(f"{folder}: no such folder")
    files = sorted(path for path in folder.iterdir() if path.is_file())
    by_ending = {path: path.suffix.lower() for path in files}
    rasters = [path for path in files if by_ending[path] in (".asc", ".tif", ".tiff")]
    dem = only(rasters, folder, "DEM (.asc or .tif)")
    layers = [path for path in files if by_ending[path] == ".geojson"]
    stems = [path for path in files if by_ending[path] == ".xyd"]
    with atomic_folder(out, [dem, *layers, *stems], last=CASE) as part:
        made = Import(folder, dem, out, part, crs)
        _note_half_cell(made)
        by_kind = _by_kind(made, layers)
        if ROCKS not in by_kind:
            raise RockfallError(
                f"{folder}: rocks are missing: give a GeoJSON of polygons with number, z, "
                "rocks_min_vol, rocks_max_vol"
            )
        if len(stems) + (FOREST in by_kind) > 1:
            only([*stems, *(by_kind[kind].path for kind in (FOREST,) if kind in by_kind)], folder,
                 "forest (.xyd or .geojson)")  # fmt: skip
        rocks, radius, number = _rocks(made, by_kind[ROCKS])
        surface = _surface(made, by_kind.get(SOILS), radius)
        rest = [*_forest(made, by_kind.get(FOREST), stems), *_lines(made, by_kind)]
        used = {dem, *layers, *stems}
        for path in files:
            if path not in used and not path.name.startswith(dem.stem + "."):
                made.left.append(f"{path.name}: settings and scripts of PlatRock are not read")
        made.write(
            "platrock",
            lambda place: [
                _case(folder, number), made.terrain(place), surface, rocks[0], rocks[1], *rest,
                Group("impact", [
                    Entry("stop_speed", STOP_SPEED, "as in PlatRock, at any slope"),
                    Entry("rest_angle", 90.0),
                ]),
                Group("flight", [Entry("gravity", GRAVITY, "as in PlatRock")]),
                Group("output", [Entry("maps", MAPS), Entry("rebounds", True)]),
            ],
        )  # fmt: skip
    return made.lists()


def _case(folder: Path, number: int) -> Group:
    title = f"{folder.resolve().name}, after PlatRock"
    return Group("case", [Entry("title", title), Entry("boulders_total", number)])


def _note_half_cell(made: Import) -> None:
    """Note the shift of PlatRock's terrain by half a cell: it takes cell corners for centres."""
    made.changed.append(
        f"{made.name(made.dem)}: elevations are at cell centres, in PlatRock at south-west "
        f"corners, so its slope lies {made.grid.cell / 2:g} m further west and south"
    )


def _by_kind(made: Import, paths: list[Path]) -> dict[str, Layer]:
    """Layers by use; refuse several layers with the same use."""
    layers: dict[str, Layer] = {}
    plain_grid = replace(made.grid, crs=None)  # PlatRock uses coordinates unchanged
    for path in paths:
        shapes, columns = read_features(path, plain_grid, [])
        layer = Layer(path, shapes, columns)
        kind = layer.kind
        if not kind:
            made.left.append(
                f"{made.name(path)}: no polygons with attributes of rocks, soils or forest, and no "
                "lines"
            )
        elif kind in layers:
            raise RockfallError(f"{path}: {kind} are already given by {layers[kind].path.name}")
        else:
            layers[kind] = layer
    return layers


def _write_layer(made: Import, name: str, layer: Layer, fields: dict[str, Any]) -> None:
    """Write the shapes of a layer with rockfall's attributes to the case folder."""
    import shapely

    crs = plan_wkt(made.grid.crs) if made.grid.crs else None
    parts = [(shapely.force_2d(layer.shapes), {k: np.array(v) for k, v in fields.items()})]
    write_geopackage(made.part / name, {Path(name).stem: ("Unknown", parts)}, crs)


def _rocks(made: Import, layer: Layer) -> tuple[tuple[Group, Group], float, int]:
    """Groups for boulders and release, radius [m] of the mean volume, and number of boulders."""
    values = layer.values(made, ROCKS)
    number = [int(value) for value in values["number"]]
    low, high = np.array(values["rocks_min_vol"]), np.array(values["rocks_max_vol"])
    for k in np.flatnonzero(low > high)[:1].tolist():
        made.refuse(
            layer.path, f"polygon {k + 1}: rocks_min_vol {low[k]:g} is above {high[k]:g}, "
            "rocks_max_vol"
        )  # fmt: skip
    alike = low == high
    fields = {
        "name": layer.names("rocks"),
        "volume": np.where(alike, "fixed", "uniform").astype(object),
        "volume_mean": np.where(alike, low, np.nan),
        "volume_min": np.where(alike, np.nan, low),
        "volume_max": np.where(alike, np.nan, high),
        "density": values["density"], "drop_height": values["z"], "velocity_z": values["vz"],
        "frequency": [float(value) for value in number],
    }  # fmt: skip
    _write_layer(made, SOURCES, layer, fields)
    total = sum(number)
    made.taken.append(
        f"{made.name(layer.path)}: {total:,} rocks of {len(number)} polygons, with volume, "
        "density, drop height and velocity"
    )
    made.changed.append(
        f"{made.name(layer.path)}: rocks start above cell centres, not anywhere in the polygons, "
        "and frequency is the number of rocks, not a rate"
    )
    mean = float(np.average((low + high) / 2, weights=number))
    boulder = Group("boulder", [Entry("volume", "source", "from the polygons")])
    release = Group("release", [Entry("polygons", SOURCES)])
    return (boulder, release), sphere_radius(mean), total


def _surface(made: Import, layer: Layer | None, radius: float) -> Group:
    """Group &surface; also writes a ground table with a row for each soil and for terrain outside
    soils, and the ground map if there are soils."""
    soils = [("outside", OUTSIDE)]
    entries = [
        Entry("ground_table", GROUNDS),
        Entry("ground", "outside", "terrain without a soil: defaults of PlatRock"),
    ]
    if layer is not None:
        values = layer.values(made, SOILS)
        n = len(layer.shapes)
        soils += [(f"soil_{k + 1}", {key: values[key][k] for key in values}) for k in range(n)]
        made.write_raster(ZONES, _soil_of_cells(made, layer))
        made.taken.append(f"{made.name(layer.path)}: {n} soils, the first where they overlap")
        entries.append(Entry("ground_map", ZONES, "ids of grounds.csv"))
    made.changed.append(
        f"terrain without a soil has PlatRock's default: R_n {OUTSIDE['R_n']:g}, R_t "
        f"{OUTSIDE['R_t']:g}, roughness {OUTSIDE['roughness']:g} m"
    )
    rows = [
        {"id": k, **_ground(made, layer, name, soil, radius)}
        for k, (name, soil) in enumerate(soils)
    ]
    columns = [*dict.fromkeys(column for row in rows for column in row)]
    with open(made.part / GROUNDS, "w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    _note_rebounds(made, {int(soil["bounce_model_number"]) for _, soil in soils}, radius)
    return Group("surface", entries)


def _soil_of_cells(made: Import, layer: Layer) -> np.ndarray:
    """Number (from 1) of the soil at each cell centre, the first if several; 0 outside soils."""
    path = made.part / "soils.gpkg"
    n = len(layer.shapes)
    ids = np.arange(n, 0, -1)  # the last polygon counts in layers
    _write_layer(made, path.name, Layer(layer.path, layer.shapes[::-1], {}), {"id": ids})
    soils = burn_polygons(path, made.grid, "id", [])
    path.unlink()
    return np.where(soils == NO_ID, 0, soils)


def _ground(
    made: Import, layer: Layer | None, name: str, soil: dict[str, float], radius: float
) -> dict[str, Any]:
    """Row of the ground table for a soil; `radius` [m] is that of the mean volume."""
    number = soil["bounce_model_number"]
    if number not in range(len(MODELS)):
        assert layer is not None
        made.refuse(
            layer.path, f"{name}: bounce_model_number = {number:g}: must be 0, 1 or 2"
        )  # fmt: skip
    model = int(number)
    angle = math.degrees(math.atan(soil["roughness"] / radius))
    return {
        "name": name, "model": MODELS[model], **{OURS[key]: soil[key] for key in NEEDED[model]},
        "roughness_angle": round(angle, 2), "source": "PlatRock",
    }  # fmt: skip


def _note_rebounds(made: Import, models: set[int], radius: float) -> None:
    made.changed.append(
        f"roughness became roughness_angle, atan(roughness/{radius:.2f} m) for the mean volume. "
        "PlatRock uses each rock's radius, and divides roughness between braking and turning"
    )
    if 0 in models:
        made.changed.append("bounce model 0 is constant: R_t also multiplies the rotation")
    if 2 in models:
        made.changed.append(
            "bounce model 2 is bourrier_hungr: friction acts on V_t - W, in PlatRock on V_t + W"
        )
    made.changed.append("directions also turn at random at each rebound (&impact turning)")


def _forest(made: Import, layer: Layer | None, stems: list[Path]) -> Iterator[Group]:
    conifers = Entry("uniform_conifers", 100.0, "[%]; PlatRock has no species, conifers stop less")
    if stems:
        rows, more = tree_rows(stems[0])
        (made.part / TREES).write_text("\n".join([*rows, ""]), encoding="utf-8")
        made.taken.append(f"{made.name(stems[0])}: {len(rows) - 1:,} stems")
        if more:
            made.left.append(f"{made.name(stems[0])}: columns after x, y and diameter")
        yield Group("forest", [Entry("trees", TREES), conifers])
    if layer is not None:
        _write_layer(made, STANDS, layer, {**layer.values(made, FOREST),
                                           "name": layer.names("stand")})  # fmt: skip
        made.taken.append(f"{made.name(layer.path)}: {len(layer.shapes)} stands")
        yield Group("forest", [Entry("polygons", STANDS), conifers])
    if stems or layer is not None:
        made.changed.append(
            "stems absorb energy as in Dorren and Berger (2006), in PlatRock by simulated hits"
        )


def _lines(made: Import, layers: dict[str, Layer]) -> Iterator[Group]:
    if (layer := layers.get(CHECKPOINTS)) is not None:
        _write_layer(made, LINES, layer, {"name": layer.names("checkpoint", 0)})
        made.taken.append(f"{made.name(layer.path)}: {len(layer.shapes)} checkpoints, from 0")
        yield Group("line", [Entry("file", LINES), Entry("field", "name")])
