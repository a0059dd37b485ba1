# SPDX-License-Identifier: BSD-3-Clause
"""Lines in detail: heights of a boulder's points, groups of boulders, positions along a line."""
