# SPDX-License-Identifier: BSD-3-Clause
"""Project layers as files for the program, and its files as styled layers."""

from pathlib import Path

from qgis.core import (
    QgsFeatureRequest,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProviderRegistry,
    QgsRasterLayer,
    QgsVectorFileWriter,
    QgsVectorLayer,
)


def write_layer(source, path, name, context, feedback):
    """Write the features of a source (any layer, or its selection) to a GeoPackage."""
    layer = source.materialize(QgsFeatureRequest(), feedback)
    fields = layer.fields()
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.layerName = name
    options.driverName = "GPKG"
    # GeoPackages number their features themselves.
    options.attributes = [k for k in range(fields.count()) if fields.at(k).name().lower() != "fid"]
    options.skipAttributeCreation = not options.attributes
    if Path(path).exists():
        options.actionOnExistingFile = QgsVectorFileWriter.CreateOrOverwriteLayer
    code, message, *_ = QgsVectorFileWriter.writeAsVectorFormatV3(
        layer, str(path), context.transformContext(), options
    )
    if code != QgsVectorFileWriter.NoError:
        raise QgsProcessingException(f"layer {source.sourceName()}: cannot be written: {message}")


def load_results(folder, context):
    """Load every map and layer in a folder into QGIS; returns their names.

    Processing loads files without the styles next to them, so they are loaded here. Source cells
    are loaded as joined areas, not as thousands of points.
    """
    found = [QgsRasterLayer(str(path), path.stem) for path in sorted(Path(folder).glob("*.tif"))]
    for path in sorted(Path(folder).glob("*.gpkg")):
        metadata = QgsProviderRegistry.instance().providerMetadata("ogr")
        parts = {one.name(): one.uri() for one in metadata.querySublayers(str(path))}
        if "source_areas" in parts:
            parts.pop("sources", None)
        for name, uri in parts.items():
            found.append(QgsVectorLayer(uri, name, "ogr"))
            found[-1].loadDefaultStyle()  # again: QGIS has switched its times off
    for layer in found:
        if not layer.isValid():
            raise QgsProcessingException(f"{layer.source()}: cannot be loaded")
        context.temporaryLayerStore().addMapLayer(layer)
        details = QgsProcessingContext.LayerDetails(layer.name(), context.project())
        context.addLayerToLoadOnCompletion(layer.id(), details)
    return [layer.source() for layer in found]
