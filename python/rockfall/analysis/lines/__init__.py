# SPDX-License-Identifier: BSD-3-Clause
"""Lines in detail: groups of boulders, positions along a line, ways around barriers, sections."""
