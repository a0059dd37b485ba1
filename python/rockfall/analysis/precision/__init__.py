# SPDX-License-Identifier: BSD-3-Clause
"""Precision of numbers, and the boulders needed for more: common rules for all statistics."""
