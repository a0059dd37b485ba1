# SPDX-License-Identifier: BSD-3-Clause
"""Results: created from tallies, and written to files."""
