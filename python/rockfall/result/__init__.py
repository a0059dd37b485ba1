# SPDX-License-Identifier: BSD-3-Clause
"""From tallies to a result, and from a result to files."""
