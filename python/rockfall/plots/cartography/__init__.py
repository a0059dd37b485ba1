# SPDX-License-Identifier: BSD-3-Clause
"""Maps on paper: relief, marks, names that keep apart, frame and scale."""
