# SPDX-License-Identifier: BSD-3-Clause
"""Coordinate reference systems and length units stated by files."""
