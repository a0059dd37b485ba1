# SPDX-License-Identifier: BSD-3-Clause
"""Rasters in and out."""
