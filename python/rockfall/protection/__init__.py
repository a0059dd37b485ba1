# SPDX-License-Identifier: BSD-3-Clause
"""Protection: performance of barriers, and their requirements."""
