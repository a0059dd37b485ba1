# SPDX-License-Identifier: BSD-3-Clause
"""Data of field experiments and events: published archives and their download."""
