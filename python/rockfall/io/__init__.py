# SPDX-License-Identifier: BSD-3-Clause
"""Input and output of foreign formats: rasters, layers, tables."""
