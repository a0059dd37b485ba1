# SPDX-License-Identifier: BSD-3-Clause
"""Lines in detail: heights of a boulder's points, groups of boulders, places along a line."""
