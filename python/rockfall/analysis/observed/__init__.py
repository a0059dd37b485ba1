# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of results with field observations."""
