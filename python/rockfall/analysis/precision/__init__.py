# SPDX-License-Identifier: BSD-3-Clause
"""How sure a number is, and how many boulders make it surer: one rule for all that asks."""
