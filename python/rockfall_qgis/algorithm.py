# SPDX-License-Identifier: BSD-3-Clause
"""Processing algorithms for all commands: their parameters become arguments of a command line."""

import re
from pathlib import Path

from qgis.core import (
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingOutputFile,
    QgsProcessingOutputMultipleLayers,
    QgsProcessingOutputString,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterFile,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterString,
    QgsProcessingUtils,
)

from rockfall_qgis.commands import DRAFTS, GROUND, KINDS, LINE, POINT, POLYGON
from rockfall_qgis.layers import load_results, write_layer
from rockfall_qgis.program import Interrupted, Refused, call

SHAPES = {
    POINT: QgsProcessing.TypeVectorPoint,
    LINE: QgsProcessing.TypeVectorLine,
    POLYGON: QgsProcessing.TypeVectorPolygon,
}


def _number(kind, least):
    return lambda one: QgsProcessingParameterNumber(
        one.name, one.label, kind, optional=one.optional, minValue=least
    )


def _file(one):
    (ending,) = one.choices
    return QgsProcessingParameterFile(one.name, one.label, extension=ending, optional=one.optional)


def _choice(one):
    return QgsProcessingParameterEnum(
        one.name, one.label, list(one.choices), optional=one.optional, usesStaticStrings=True
    )


def _layer(one):
    shapes = [SHAPES[shape] for shape in one.choices]
    return QgsProcessingParameterFeatureSource(one.name, one.label, shapes, optional=one.optional)


def _new_file(filter_):
    """A file to be written; optional files are not written by default."""
    return lambda one: QgsProcessingParameterFileDestination(
        one.name, one.label, filter_, optional=one.optional, createByDefault=not one.optional
    )


#: Kinds of output parameters.
WRITTEN = {"folder", "maps", "page", "table", "runs"}
#: Constructors of parameters, by the kind of the option.
MAKERS = {
    "count": _number(QgsProcessingParameterNumber.Integer, 1),
    "number": _number(QgsProcessingParameterNumber.Integer, 0),
    "real": _number(QgsProcessingParameterNumber.Double, 0.0),
    "file": _file,
    "choice": _choice,
    "layer": _layer,
    "text": lambda one: QgsProcessingParameterString(one.name, one.label, optional=one.optional),
    "yes": lambda one: QgsProcessingParameterBoolean(one.name, one.label, False),
    "raster": lambda one: QgsProcessingParameterRasterLayer(
        one.name, one.label, optional=one.optional
    ),
    "folder": lambda one: QgsProcessingParameterFolderDestination(one.name, one.label),
    "maps": lambda one: QgsProcessingParameterFolderDestination(
        one.name, one.label, optional=True, createByDefault=False
    ),
    "page": _new_file("HTML (*.html);;PDF (*.pdf)"),
    "table": _new_file("CSV (*.csv)"),
    "runs": _new_file("netCDF (*.nc);;CSV (*.csv)"),
    "files": lambda one: QgsProcessingParameterMultipleLayers(
        one.name, one.label, QgsProcessing.TypeFile, optional=one.optional
    ),
}


class CommandAlgorithm(QgsProcessingAlgorithm):
    """A command of the program."""

    def __init__(self, command, program_path):
        super().__init__()
        self.command = command
        self.program_path = program_path

    def createInstance(self):
        return type(self)(self.command, self.program_path)

    def name(self):
        return self.command.name

    def displayName(self):
        return self.command.title

    def shortHelpString(self):
        return self.command.about

    def canExecute(self):
        there = bool(self.program_path())
        return there, "" if there else "The program rockfall is not on the PATH: give its path " \
            "in Settings, Options, Processing, Providers, Rockfall"  # fmt: skip

    def initAlgorithm(self, configuration=None):
        for one in self.command.options:
            parameter = MAKERS[one.kind](one)
            if one.advanced:
                advanced = QgsProcessingParameterDefinition.FlagAdvanced
                parameter.setFlags(parameter.flags() | advanced)
            self.addParameter(parameter)
        self.addOutput(QgsProcessingOutputString("TEXT", "Output of the program"))
        if self._is_loaded():
            self.addOutput(QgsProcessingOutputMultipleLayers("LAYERS", "Maps and layers"))

    def processAlgorithm(self, parameters, context, feedback):
        able, why = self.canExecute()
        if not able:
            raise QgsProcessingException(why)
        results = self._places(parameters, context)
        try:
            results["TEXT"] = "\n".join(self._called(parameters, context, feedback))
        except Refused as error:
            raise QgsProcessingException(str(error)) from error
        except Interrupted as error:
            feedback.pushWarning(str(error))
            return results
        maps = self._maps(parameters, context) if self._is_loaded() else ""
        if maps:
            results["LAYERS"] = load_results(maps, context)
        return results

    def _is_loaded(self):
        return self.command.name in ("run", "export", "hazard", "compare")

    def _places(self, parameters, context):
        """Output paths of files and folders."""
        return {
            one.name: self.parameterAsString(parameters, one.name, context)
            for one in self.command.options
            if one.kind in WRITTEN
        }

    def _maps(self, parameters, context):
        """Folder of the results to load; "" if there are none."""
        name = "MAPS" if self.command.name == "compare" else "FOLDER"
        return self.parameterAsString(parameters, name, context)

    def _called(self, parameters, context, feedback):
        """Call the program and return its output."""
        words = self._words(self.command.options, parameters, context, feedback)
        return self._program(feedback, self.command.name, *words)

    def _program(self, feedback, *words):
        return call([self.program_path(), *words], feedback)

    def _words(self, options, parameters, context, feedback):
        """Command line for the parameters."""
        for one in options:
            if parameters.get(one.name) in (None, ""):
                continue
            if one.kind == "files":
                yield from self.parameterAsFileList(parameters, one.name, context)
                continue
            value = self._value(one, parameters, context, feedback)
            if one.kind == "yes":
                yield from [one.flag] if value else []
                continue
            yield from [one.flag, value] if one.flag else [value]
            if one.flag == "-o" and one.kind == "page" and value.lower().endswith(".pdf"):
                yield "--pdf"

    def _value(self, one, parameters, context, feedback):
        if one.kind == "raster":
            return _raster_file(self.parameterAsRasterLayer(parameters, one.name, context))
        if one.kind == "layer":
            path = QgsProcessingUtils.generateTempFilename(f"{one.name.lower()}.gpkg")
            source = self.parameterAsSource(parameters, one.name, context)
            write_layer(source, path, one.name.lower(), context, feedback)
            return path
        if one.kind in ("count", "number"):
            return str(self.parameterAsInt(parameters, one.name, context))
        if one.kind == "real":
            return repr(self.parameterAsDouble(parameters, one.name, context))
        if one.kind == "yes":
            return self.parameterAsBool(parameters, one.name, context)
        if one.kind == "choice":
            return self.parameterAsEnumString(parameters, one.name, context)
        return self.parameterAsString(parameters, one.name, context)


def _raster_file(layer):
    """File of a raster layer."""
    if layer is None or layer.dataProvider().name() != "gdal":
        raise QgsProcessingException("elevations must be a raster in a file")
    return layer.source()


class DraftAlgorithm(CommandAlgorithm):
    """Algorithm that drafts a case from layers of the project."""

    def _folder(self, parameters, context):
        """Folder of the case, which is made if it is missing."""
        folder = Path(self.parameterAsString(parameters, "FOLDER", context))
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def _draft(self, folder, parameters, context, feedback):
        """Draft a case from layers in the folder; returns the program's output."""
        case, layers, before = folder / "case.nml", folder / "layers.gpkg", {*folder.iterdir()}
        for path in case, layers:
            if path in before:
                raise QgsProcessingException(
                    f"{path}: already exists; not overwritten: run it as a case, or take "
                    "another folder"
                )
        given = [one for one in DRAFTS if parameters.get(one.name) not in (None, "")]
        dem = _raster_file(self.parameterAsRasterLayer(parameters, "DEM", context))
        words = ["new", dem, *([str(layers)] if given else []), "-o", str(case)]
        if ground := self.parameterAsEnumString(parameters, GROUND.name, context):
            words += ["--ground", ground]
        try:
            for one in given:
                source = self.parameterAsSource(parameters, one.name, context)
                write_layer(source, layers, one.name.lower(), context, feedback)
            said = self._program(feedback, *words)
            _check_taken(given, said)
        except (Refused, Interrupted, QgsProcessingException):
            for path in {*folder.iterdir()} - before:
                path.unlink()
            raise
        return said


class NewAlgorithm(DraftAlgorithm):
    """Algorithm of `rockfall new`: a case of layers of the project."""

    def initAlgorithm(self, configuration=None):
        super().initAlgorithm(configuration)
        self.addOutput(QgsProcessingOutputFile("CASE", "Case"))

    def _places(self, parameters, context):
        folder = Path(self.parameterAsString(parameters, "FOLDER", context))
        return {**super()._places(parameters, context), "CASE": str(folder / "case.nml")}

    def _called(self, parameters, context, feedback):
        return self._draft(self._folder(parameters, context), parameters, context, feedback)


class RunAlgorithm(DraftAlgorithm):
    """`rockfall run` of a case, or of layers by `rockfall new`; loads the maps."""

    def checkParameterValues(self, parameters, context):
        given = {name for name, value in parameters.items() if value not in (None, "")}
        drafts = {one.name for one in (*DRAFTS, GROUND)}
        if len(given & {"CASE", "DEM"}) != 1:
            return False, "Give either a case, or elevations (and layers that go with them)"
        if "CASE" in given and given & drafts:
            return False, "A case names its own layers: those given here go with elevations"
        return super().checkParameterValues(parameters, context)

    def _maps(self, parameters, context):
        return str(Path(super()._maps(parameters, context)) / "maps")

    def _called(self, parameters, context, feedback):
        folder = self._folder(parameters, context)
        case = self.parameterAsString(parameters, "CASE", context)
        if not case:
            self._draft(folder, parameters, context, feedback)
            case = str(folder / "case.nml")
        result = str(folder / "result.nc")
        options = [one for one in self.command.options if one.flag and one.name != "FOLDER"]
        words = self._words(options, parameters, context, feedback)
        said = self._program(feedback, "run", case, "-o", result, *words)
        export = ["export", result, self._maps(parameters, context)]
        replace = self.parameterAsBool(parameters, "OVERWRITE", context)
        self._program(feedback, *export, *(["--overwrite"] if replace else []))
        return said


def _check_taken(given, said):
    """Refuse layers that `rockfall new` used for another purpose than intended."""
    for one in given:
        name = one.name.lower()
        for line in said:
            found = re.search(rf"(?:, layer {name}|layers\.gpkg): (\w+)", line)
            if found and found[1] not in KINDS.get(name, {name}):
                raise QgsProcessingException(line)
