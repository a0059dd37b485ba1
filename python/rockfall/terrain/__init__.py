# SPDX-License-Identifier: BSD-3-Clause
"""Terrain geometry: heights between cell centres, positions along polylines, dams."""
