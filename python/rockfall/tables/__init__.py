# SPDX-License-Identifier: BSD-3-Clause
"""Contents of outputs as tables and notes, defined once for all formats."""
