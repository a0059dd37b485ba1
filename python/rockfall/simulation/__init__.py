# SPDX-License-Identifier: BSD-3-Clause
"""From a scene to the tallies of its boulders."""
