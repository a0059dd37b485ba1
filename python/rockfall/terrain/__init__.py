# SPDX-License-Identifier: BSD-3-Clause
"""Terrain geometry: heights between cell centres, places along polylines, dams."""
