# SPDX-License-Identifier: BSD-3-Clause
"""Simulation: from a scene to the tallies of its boulders."""
