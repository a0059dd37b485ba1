# SPDX-License-Identifier: BSD-3-Clause
"""Text output of results for a terminal."""
