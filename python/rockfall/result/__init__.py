# SPDX-License-Identifier: BSD-3-Clause
"""Results: made from tallies, and written to files."""
