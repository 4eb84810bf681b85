#!/usr/bin/env python3
"""What QGIS itself makes of a project: run by the Python that has its bindings.

usage: qgis_project.py PROJECT.qgs PICTURE.png

Prints JSON: of each layer whether it is valid, shown, its provider, number of features, rules and label; the features that
each rule takes; and what of the picture is not background.
"""
import json
import sys
import xml.etree.ElementTree

from qgis.core import (QgsApplication, QgsMapRendererParallelJob, QgsMapSettings, QgsProject, QgsRectangle,
                       QgsRuleBasedRenderer, QgsExpressionContext, QgsExpressionContextUtils)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor

QgsApplication.setPrefixPath("/usr", True)
application = QgsApplication([], False)
application.initQgis()
project = QgsProject.instance()
loaded = project.read(sys.argv[1])
layers, shown = {}, []
for node in project.layerTreeRoot().findLayers():
    layer = node.layer()
    if layer is None or not layer.isValid():
        layers[node.name()] = {"valid": False, "error": "" if layer is None else layer.error().message()}
        continue
    renderer = layer.renderer()
    taken = {}
    if isinstance(renderer, QgsRuleBasedRenderer):
        context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
        for rule in renderer.rootRule().children():
            expression = rule.filter()
            if expression is not None and expression.hasParserError():
                raise SystemExit(f"{node.name()}: {expression.parserErrorString()}")
            count = 0
            for feature in layer.getFeatures():
                context.setFeature(feature)
                count += rule.isFilterOK(feature) if expression is None else bool(expression.evaluate(context))
            taken[rule.label()] = count
    label = None
    texts = []
    if layer.labelsEnabled():
        settings = layer.labeling().settings()
        label = settings.fieldName
        expression = settings.getLabelExpression()
        context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
        for feature in layer.getFeatures():
            context.setFeature(feature)
            value = expression.evaluate(context)
            texts.append(f"error: {expression.evalErrorString()}" if expression.hasEvalError() else str(value))
    visible = node.isVisible()
    if visible:
        shown.append(layer)
    layers[node.name()] = {"valid": True, "shown": visible, "provider": layer.providerType(), "features": layer.featureCount(),
                           "fields": [field.name() for field in layer.fields()], "rules": taken, "label": label,
                           "texts": sorted(set(texts))[:20], "crs": layer.crs().authid(), "source": layer.source()}
    if layer.providerType() == "postgres":
        # As a layer that somebody adds by hand: QGIS asks the database for its default style.
        style, found = layer.loadDefaultStyle()
        layers[node.name()]["default_style"] = [found, type(layer.renderer()).__name__]
settings = QgsMapSettings()
settings.setLayers(shown)
settings.setBackgroundColor(QColor(255, 255, 255))
settings.setOutputSize(QSize(1200, 900))
settings.setDestinationCrs(project.crs())
# What QGIS shows first; the whole world where nothing is in the catalogue.
extent = xml.etree.ElementTree.parse(sys.argv[1]).find("mapcanvas/extent")
corners = [-2e7, -2e7, 2e7, 2e7] if extent is None else [float(extent.findtext(name)) for name in ("xmin", "ymin", "xmax", "ymax")]
settings.setExtent(QgsRectangle(*corners))
job = QgsMapRendererParallelJob(settings)
job.start()
job.waitForFinished()
picture = job.renderedImage()
picture.save(sys.argv[2])
colours, painted = set(), 0
for y in range(0, picture.height(), 3):
    for x in range(0, picture.width(), 3):
        colour = picture.pixel(x, y)
        colours.add(colour)
        painted += colour != 0xFFFFFFFF
print(json.dumps({"loaded": loaded, "crs": project.crs().authid(), "layers": layers, "colours": len(colours),
                  "painted": painted / (picture.width() // 3 * (picture.height() // 3)),
                  "errors": [error.message for error in job.errors()]}))
application.exitQgis()
