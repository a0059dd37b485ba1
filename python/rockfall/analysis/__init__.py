# SPDX-License-Identifier: BSD-3-Clause
"""Analysis of results: statistics, return levels, comparison, validity, hazard."""
