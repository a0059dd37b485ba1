# SPDX-License-Identifier: BSD-3-Clause
"""Precision of results and required number of boulders: common rules for all statistics."""
