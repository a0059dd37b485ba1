# SPDX-License-Identifier: BSD-3-Clause
"""Foreign formats in and out: rasters, layers, tables."""
