# SPDX-License-Identifier: BSD-3-Clause
"""Open a project with PyQGIS, in the Python of the distribution, and draw its map and layouts.
Prints one JSON object. Usage: opened.py PROJECT.qgz PICTURE, which begins the names of pictures."""

import json
import os
import sys

from qgis.core import (
    QgsApplication,
    QgsLayoutExporter,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsProject,
    QgsProjectBadLayerHandler,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize

QgsApplication.setPrefixPath("/usr", True)
app = QgsApplication([], False)
app.initQgis()
path, picture = sys.argv[1:]
bad = []


class Handler(QgsProjectBadLayerHandler):
    """Records layers that QGIS cannot find, in `bad`."""

    def handleBadLayers(self, layers):
        bad.extend(layers)


project, handler = QgsProject.instance(), Handler()
project.setBadLayerHandler(handler)
answers = {"read": project.read(path), "bad": len(bad)}
layers = list(project.mapLayers().values())
answers["missing"] = [one.name() for one in layers if not one.isValid()]
answers["crs"] = project.crs().authid()
answers["layer_crs"] = [one.crs().authid() for one in layers]
root = project.layerTreeRoot()
answers["groups"] = [one.name() for one in root.children()]
shown = [one for one in root.layerOrder() if root.findLayer(one.id()).isVisible()]
answers["visible"] = [one.name() for one in shown]
answers["labelled"] = [
    one.name() for one in layers if isinstance(one, QgsVectorLayer) and one.labelsEnabled()
]
extent = project.viewSettings().defaultViewExtent()
answers["extent"] = [
    extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum(),
]  # fmt: skip


def drawn(chosen):
    """Rendered image of the `chosen` layers."""
    settings = QgsMapSettings()
    settings.setDestinationCrs(project.crs())
    settings.setLayers(chosen)
    settings.setExtent(extent)
    settings.setOutputSize(QSize(400, 400))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    return job.renderedImage()


def differing(one, other):
    dots = [(x, y) for x in range(0, 400, 2) for y in range(0, 400, 2)]
    return sum(one.pixel(*at) != other.pixel(*at) for at in dots) / len(dots)


everything = drawn(shown)
everything.save(f"{picture}_map.png")
answers["ink"] = {"all": differing(everything, drawn([]))}
for name in ("Trajectories", "Sources"):
    without = [one for one in shown if one.name() != name]
    answers["ink"][name] = differing(everything, drawn(without))
answers["themes"] = project.mapThemeCollection().mapThemes()
answers["layouts"] = []
for k, layout in enumerate(project.layoutManager().printLayouts()):
    settings = QgsLayoutExporter.ImageExportSettings()
    settings.dpi, settings.generateWorldFile = 50, False
    printed = QgsLayoutExporter(layout).exportToImage(f"{picture}_{k}.png", settings)
    chart, legend = layout.itemById("map"), layout.itemById("legend")
    page = layout.pageCollection().page(0).pageSize()
    model = legend.model()
    rows = [one.layer() for one in model.rootGroup().findLayers()]
    texts = [node.data(0) for one in model.rootGroup().findLayers()
             for node in model.layerLegendNodes(one)]  # fmt: skip
    answers["layouts"].append({
        "name": layout.name(), "printed": printed, "scale": chart.scale(),
        "paper": [page.width(), page.height()],
        "legend": [one.name() for one in rows] + texts,
        "legend_right": legend.pos().x() + legend.rect().width(),
        "legend_bottom": legend.pos().y() + legend.rect().height(),
        "foot_top": layout.itemById("scale").pos().y(),
    })  # fmt: skip
print(json.dumps(answers), flush=True)
os._exit(0)  # PyQGIS may crash during shutdown
