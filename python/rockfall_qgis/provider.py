# SPDX-License-Identifier: BSD-3-Clause
"""Provider of Processing, and its one setting: the path of the program."""

import shutil

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider

from rockfall_qgis.algorithm import CommandAlgorithm, NewAlgorithm, RunAlgorithm
from rockfall_qgis.commands import COMMANDS

PROGRAM = "ROCKFALL_PROGRAM"
#: Algorithms that do more than call one command.
KINDS = {"new": NewAlgorithm, "run": RunAlgorithm}


def program_path():
    """Path of the program from the setting, or else from PATH; "" if not found."""
    return ProcessingConfig.getSetting(PROGRAM) or shutil.which("rockfall") or ""


class Provider(QgsProcessingProvider):
    """The algorithms of rockfall in the toolbox of QGIS."""

    def id(self):
        return "rockfall"

    def name(self):
        return "Rockfall"

    def load(self):
        about = "Path of the program rockfall (empty: the one on the PATH)"
        setting = Setting(self.name(), PROGRAM, about, "", valuetype=Setting.FILE)
        ProcessingConfig.settingIcons[self.name()] = self.icon()
        ProcessingConfig.addSetting(setting)
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self):
        ProcessingConfig.removeSetting(PROGRAM)

    def loadAlgorithms(self):
        for command in COMMANDS:
            kind = KINDS.get(command.name, CommandAlgorithm)
            self.addAlgorithm(kind(command, program_path))


class Plugin:
    """Plugin that QGIS starts and stops."""

    def __init__(self):
        self.provider = None

    def initProcessing(self):
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self):
        self.initProcessing()

    def unload(self):
        QgsApplication.processingRegistry().removeProvider(self.provider)
