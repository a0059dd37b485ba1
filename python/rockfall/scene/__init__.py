# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of a case and its files to kernel arrays."""
