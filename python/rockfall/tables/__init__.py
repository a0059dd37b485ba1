# SPDX-License-Identifier: BSD-3-Clause
"""Contents as tables and notes, each made in one place for all formats."""
