# SPDX-License-Identifier: BSD-3-Clause
"""Make the figures of the tutorial by following it.

`python tools/figures.py FOLDER` writes them to FOLDER/tutorial. It fails if a page differs from the
program's output. Takes a minute.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pyogrio
import rasterio
import shapely
from matplotlib.colors import LightSource
from tutorial import differences

OF_THE_TUTORIAL = (
    "case.html",
    "figures/trajectories.png",
    "figures/profile.png",
    "figures/pass_frequency.png",
    "hazard_hazard/hazard_class.png",
)
GROUNDS = {
    "rock": "#8c8c8c",
    "coarse scree": "#c9a66b",
    "fine scree": "#e3cf9f",
    "pasture": "#b5cf8f",
}


def tutorial(out: Path) -> None:
    """Follow the tutorial, and store its figures and its page in `out`."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for difference in differences(Path(folder)):
            sys.exit(difference)
        for name in OF_THE_TUTORIAL:
            shutil.copy(Path(folder) / name, out)
        site(Path(folder), out / "site.png")


def site(folder: Path, out: Path) -> None:
    """Draw the layers of the tutorial over the relief."""
    with rasterio.open(folder / "dem.tif") as file:
        z, box = file.read(1), file.bounds
    figure, axes = plt.subplots(figsize=(6, 7.4), layout="constrained")
    extent = (box.left, box.right, box.bottom, box.top)
    grounds, names = layer(folder / "site.gpkg", "ground")
    for shape, name in zip(grounds, names, strict=True):
        axes.fill(*shape.exterior.xy, color=GROUNDS[name])
        axes.text(shape.bounds[0] + 8, shape.bounds[1] + 8, name, fontsize=9)
    shade = LightSource(315, 45).hillshade(z, dx=2, dy=2)
    axes.imshow(shade, cmap="gray", extent=extent, alpha=0.35, zorder=2)
    heights = axes.contour(
        z, levels=range(850, 1100, 10), extent=extent, origin="upper", colors="k", linewidths=0.3
    )
    axes.clabel(heights, heights.levels[::5], fontsize=7)
    trees, _ = layer(folder / "forest.gpkg", "trees")
    axes.plot(
        *shapely.get_coordinates(trees).T, ".", ms=2, color="#2d6a2d", zorder=3, label="trees"
    )
    looks = {
        ("site.gpkg", "cliff"): {"color": "#c0392b", "lw": 1.5},
        ("site.gpkg", "road"): {"color": "k", "lw": 2.5},
        ("net.gpkg", "net"): {"color": "#1f5fa8", "lw": 2, "ls": "--"},
        ("site.gpkg", "houses"): {"color": "#6c3483", "lw": 1.5},
    }
    for (file, name), look in looks.items():
        for number, shape in enumerate(layer(folder / file, name)[0]):
            line = shape.exterior if shape.geom_type == "Polygon" else shape
            axes.plot(*line.xy, zorder=4, label=None if number else name, **look)
    axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", xlabel="E [m]", ylabel="N [m]")
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.locator_params(nbins=5)
    axes.legend(loc="lower right", ncols=2)
    figure.savefig(out, dpi=150)
    plt.close(figure)


def layer(path: Path, name: str) -> tuple[list, list]:
    """Shapes of a layer, and their names, if any."""
    meta, _, shapes, columns = pyogrio.raw.read(path, layer=name)
    called = dict(zip(meta["fields"], columns, strict=True)).get("name", [])
    return list(shapely.from_wkb(shapes)), list(called)


if __name__ == "__main__":
    plt.switch_backend("agg")
    tutorial(Path(sys.argv[1]) / "tutorial")
