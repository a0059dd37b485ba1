# SPDX-License-Identifier: BSD-3-Clause
"""Rebounds and breakage by the kernel's rules, and impact sets as numbers."""
