# SPDX-License-Identifier: BSD-3-Clause
"""Printed maps: relief, marks, non-overlapping labels, frame and scale."""
