# SPDX-License-Identifier: BSD-3-Clause
"""The impact laboratory: impact sets from discrete-element impacts of a sphere on a layer of rocks.

A `LabCase` defines layers and impacts, `run_impacts` simulates them, `fit_impacts` fits impact sets
to them, `fit_contacts` fits sets to measured contacts, `scorecard` compares sets with published
numbers.
"""
