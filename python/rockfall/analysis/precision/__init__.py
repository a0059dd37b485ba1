# SPDX-License-Identifier: BSD-3-Clause
"""Precision of numbers, and the number of boulders required: common rules for all statistics."""
