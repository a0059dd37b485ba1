# SPDX-License-Identifier: BSD-3-Clause
"""A scene that stays open: changes to it, and its runs in batches."""
