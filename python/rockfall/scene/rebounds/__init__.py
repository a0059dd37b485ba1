# SPDX-License-Identifier: BSD-3-Clause
"""Rebounds and breakage with the kernel's rules, and impact sets as numbers."""
