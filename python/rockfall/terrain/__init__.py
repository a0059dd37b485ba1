# SPDX-License-Identifier: BSD-3-Clause
"""Shapes on the ground: heights between cell centres, places along polylines, dams."""
