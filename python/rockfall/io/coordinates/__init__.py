# SPDX-License-Identifier: BSD-3-Clause
"""Coordinate reference systems and units of lengths, as files state them."""
