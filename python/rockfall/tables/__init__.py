# SPDX-License-Identifier: BSD-3-Clause
"""Contents as tables and notes, each defined once for all formats."""
