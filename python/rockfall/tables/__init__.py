# SPDX-License-Identifier: BSD-3-Clause
"""Contents of outputs as tables and notes, shared by all formats."""
