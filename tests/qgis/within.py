# SPDX-License-Identifier: BSD-3-Clause
"""Run by the distribution's Python, with PyQGIS: what the provider does with layers of a project.
Prints one JSON object. Usage: within.py FOLDER_OF_PLUGIN DEM PROGRAM, in an empty folder."""

import json
import os
import sys
from pathlib import Path

from qgis.core import (
    QgsApplication,
    QgsFeature,
    QgsGeometry,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
    QgsVectorLayer,
    QgsWkbTypes,
)

QgsApplication.setPrefixPath("/usr", True)
app = QgsApplication([], False)
app.initQgis()
plugin, dem, program = sys.argv[1:]
sys.path[:0] = [plugin, f"{QgsApplication.pkgDataPath()}/python/plugins"]

import processing  # noqa: E402  lies in QGIS's own folder
from processing.core.Processing import Processing  # noqa: E402
from processing.core.ProcessingConfig import ProcessingConfig  # noqa: E402

from rockfall_qgis.provider import PROGRAM, Provider, program_path  # noqa: E402

Processing.initialize()
provider = Provider()
QgsApplication.processingRegistry().addProvider(provider)
project = QgsProject.instance()


def memory_layer(name, rings, field="", value=None):
    """A layer of the project, of boxes (x, y, x, y), that is in no file."""
    layer = QgsVectorLayer(f"Polygon?crs=EPSG:32632&field=fid:integer{field}", name, "memory")
    for ring in rings:
        feature = QgsFeature(layer.fields())
        feature.setAttributes([1] if value is None else [1, value])  # fid 1 for each: not unique
        feature.setGeometry(QgsGeometry.fromRect(QgsRectangle(*ring)))
        layer.dataProvider().addFeatures([feature])
    project.addMapLayer(layer)
    return layer.name()


def run(name, **parameters):
    """What an algorithm returns and has loaded, or the line with which it refuses."""
    context, feedback = QgsProcessingContext(), QgsProcessingFeedback(False)
    context.setProject(project)
    try:
        found = processing.run(f"rockfall:{name}", parameters, context=context, feedback=feedback)
    except QgsProcessingException as error:
        return {"refused": str(error), "left": sorted(os.listdir("refused"))}
    loaded = [context.temporaryLayerStore().mapLayer(k) for k in context.layersToLoadOnCompletion()]
    return {"found": found, "loaded": {layer.name(): looks(layer) for layer in loaded}}


def looks(layer):
    """How a layer is drawn: labels of its classes; of shapes also how many there are."""
    if not isinstance(layer, QgsRasterLayer):
        renderer = layer.renderer()
        labels = [item.label() for item in renderer.legendSymbolItems()]
        times = layer.temporalProperties()
        return {
            "shapes": layer.featureCount(),
            "type": renderer.type(),
            "labels": labels,
            "kind": QgsWkbTypes.displayString(layer.wkbType()),
            "plays": times.isActive() and [times.startField(), times.endField()],
        }
    renderer = layer.renderer()
    return [renderer.type(), *(label for label, _ in renderer.legendSymbologyItems())]


W, N = 600000.0, 5000000.0
boxes = [(W + 100, N - 60, W + 150, N - 30), (W + 150, N - 60, W + 200, N - 30)]
cliff = memory_layer("my faces", boxes)
bare = memory_layer("no radius", [(W, N - 390, W + 300, N)], "&field=colour:string", "red")
Path("refused").mkdir()
answers = {}
ProcessingConfig.setSettingValue(PROGRAM, dem)
answers["setting"] = program_path()
answers["no program"] = run("check", CASE="case.nml")
ProcessingConfig.setSettingValue(PROGRAM, program)
Path("bad.nml").write_text("&terrain dem = 'no.tif' /\n&cse /\n")
answers["bad case"] = run("run", CASE="bad.nml", FOLDER="refused")
answers["both"] = run("run", CASE="bad.nml", DEM=dem, FOLDER="refused")
answers["neither"] = run("run", FOLDER="refused")
answers["not zones"] = run("run", DEM=dem, ZONES=bare, SOURCES=cliff, FOLDER="refused")
how = {"DEM": dem, "SOURCES": cliff, "BOULDERS": 3, "SEED": 7, "THREADS": 1}
answers["run"] = run("run", **how, FOLDER="project")
answers["again"] = run("run", **how, FOLDER="project")
answers["check"] = run("check", CASE="project/case.nml")
print(json.dumps(answers), flush=True)
os._exit(0)  # PyQGIS may crash while it is taken down
