# SPDX-License-Identifier: BSD-3-Clause
"""The impact laboratory: impact sets and impact tables from discrete-element simulations.

A `LabCase` defines layers and impacts, `run_impacts` simulates them, `fit_impacts` fits impact sets
to them, `fit_contacts` fits sets to measured contacts, `table_of` makes impact tables, and
`scorecard` compares sets with published numbers. `rockfall` never imports this package.
"""
