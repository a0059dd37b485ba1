# SPDX-License-Identifier: BSD-3-Clause
"""What a result says: statistics, return levels, comparison, convergence, uncertainty."""
