# SPDX-License-Identifier: BSD-3-Clause
"""A result as a project of QGIS (.qgz): layers in groups with their styles, and layouts for
printing. Written without QGIS."""
