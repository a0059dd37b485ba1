# SPDX-License-Identifier: BSD-3-Clause
"""Run the provider with PyQGIS, in the Python of the distribution, on layers of a project. Prints
one JSON object. Usage: within.py FOLDER_OF_PLUGIN DEM PROGRAM, in an empty folder."""

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


def memory_layer(name, shapes, fields="", *values, kind="Polygon"):
    """Add a layer in memory to the project, with shapes given as WKT or boxes (west, south, east,
    north); return its name."""
    layer = QgsVectorLayer(f"{kind}?crs=EPSG:32632&field=fid:integer{fields}", name, "memory")
    for shape in shapes:
        feature = QgsFeature(layer.fields())
        feature.setAttributes([1, *values])  # fid 1 for each: not unique
        box = isinstance(shape, tuple)
        geometry = QgsGeometry.fromRect(QgsRectangle(*shape)) if box else None
        feature.setGeometry(geometry or QgsGeometry.fromWkt(shape))
        layer.dataProvider().addFeatures([feature])
    project.addMapLayer(layer)
    return layer.name()


def run(name, **parameters):
    """Outputs and loaded layers of an algorithm, or its refusal and the files that it left."""
    context, feedback = QgsProcessingContext(), QgsProcessingFeedback(False)
    context.setProject(project)
    try:
        found = processing.run(f"rockfall:{name}", parameters, context=context, feedback=feedback)
    except QgsProcessingException as error:
        return {"refused": str(error), "left": sorted(os.listdir("refused"))}
    loaded = [context.temporaryLayerStore().mapLayer(k) for k in context.layersToLoadOnCompletion()]
    return {"found": found, "loaded": {layer.name(): looks(layer) for layer in loaded}}


def looks(layer):
    """Style of a layer as shown: labels of its classes and, for vectors, number of shapes and
    times."""
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
answers["not zones"] = run(
    "run", DEM=dem, ZONES=bare, SOURCES=cliff, GROUND="talus", FOLDER="refused"
)
answers["no ground"] = run("run", DEM=dem, SOURCES=cliff, FOLDER="refused")
how = {"DEM": dem, "SOURCES": cliff, "GROUND": "talus", "BOULDERS": 3, "SEED": 7, "THREADS": 1}
answers["run"] = run("run", **how, FOLDER="project")
answers["again"] = run("run", **how, FOLDER="project")
answers["check"] = run("check", CASE="project/case.nml")

line = f"LineString ({W} {N - 45}, {W + 300} {N - 45})"
crest = f"LineString ({W + 50} {N - 150}, {W + 250} {N - 150})"
net = f"LineString ({W + 50} {N - 100}, {W + 250} {N - 100})"
strong = "&field=height:double&field=capacity:double"
drafts = {
    "SOURCES": cliff,
    "GROUND": "meadow",
    "LINES": memory_layer("track", [line], "&field=name:string", "road", kind="LineString"),
    "BARRIERS": memory_layer("mesh", [net], strong, 3.0, 500.0, kind="LineString"),
    "DAMS": memory_layer("bank", [crest], "&field=height:double", 25.0, kind="LineString"),
    "FOREST": memory_layer("beeches", [(W, N - 380, W + 300, N - 200)],
                           "&field=stems:double&field=dbh_mean:double&field=dbh_std:double", 400.0,
                           30.0, 8.0),
}  # fmt: skip
answers["new"] = run("new", DEM=dem, FOLDER="drawn", **drafts)
flat = memory_layer("flat dam", [crest], kind="LineString")
answers["not a dam"] = run("new", DEM=dem, DAMS=flat, GROUND="rock", FOLDER="refused")
text = Path("drawn/case.nml").read_text()
for group, lines in {
    "varied": "&ensemble runs = 8, volume_factor = 1.2 /\n",
    "zoned": "&scenario name = 'all', return_period = 10.0 /\n",
}.items():
    Path(f"drawn/{group}.nml").write_text(f"{text}\n{lines}")
few = {"BOULDERS": 3, "SEED": 7, "THREADS": 1}
answers["protected"] = run("run", CASE="drawn/case.nml", **few, FOLDER="protected")
answers["ensemble"] = run("ensemble", CASE="drawn/varied.nml", RUNS=8, **few, OUT="varied.csv")
answers["hazard"] = run("hazard", CASE="drawn/zoned.nml", **few, FOLDER="zones",
                        OBJECTS=drafts["LINES"])  # fmt: skip
Path("seen.csv").write_text("distance\n" + "".join(f"{40 + 5 * k}\n" for k in range(12)))
answers["back"] = run("back", CASE="drawn/varied.nml", OBSERVED=["seen.csv"], MEMBERS=32,
                      EFFECTIVE=2, BOULDERS=1, THREADS=1, FOLDER="back")  # fmt: skip
answers["observed"] = run("compare", RESULTS=["protected/result.nc"], OBSERVED=["seen.csv"],
                          TABLE="seen_table.csv")  # fmt: skip
os.rename("protected/result.nc", "protected/net.nc")
results = ["project/result.nc", "protected/net.nc"]
answers["compare"] = run("compare", RESULTS=results, TABLE="variants.csv", MAPS="differences",
                         PAGE="variants.html")  # fmt: skip
answers["export"] = run("export", RESULT="protected/net.nc", FOLDER="whole", QGIS=True)
answers["written"] = sorted(str(path) for path in Path().rglob("*") if path.is_file())
answers["case"] = text
print(json.dumps(answers), flush=True)
os._exit(0)  # PyQGIS may crash during shutdown
