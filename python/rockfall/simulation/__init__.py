# SPDX-License-Identifier: BSD-3-Clause
"""Simulation: from a scene to tallies of its boulders."""
