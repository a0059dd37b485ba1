# SPDX-License-Identifier: BSD-3-Clause
"""A result as a QGIS project (.qgz) with styled layers and layouts, without QGIS."""
