# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of impact sets with published numbers, on a stand-in for the experimental slope."""
