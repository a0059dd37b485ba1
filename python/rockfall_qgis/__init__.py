# SPDX-License-Identifier: BSD-3-Clause
"""rockfall in the Processing toolbox of QGIS. It calls the installed program and imports none of
it: QGIS has a Python of its own."""


def classFactory(iface):
    """What QGIS calls when it loads the plugin; without a window `iface` is None."""
    from rockfall_qgis.provider import Plugin

    return Plugin()
