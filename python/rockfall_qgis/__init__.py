# SPDX-License-Identifier: BSD-3-Clause
"""Plugin that provides rockfall in the Processing toolbox of QGIS. It calls the installed program
and imports none of it, since QGIS has its own Python."""


def classFactory(iface):
    """Create the plugin for QGIS; without a window `iface` is None."""
    from rockfall_qgis.provider import Plugin

    return Plugin()
