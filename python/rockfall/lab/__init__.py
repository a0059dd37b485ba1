# SPDX-License-Identifier: BSD-3-Clause
"""The impact laboratory: impact sets from discrete-element impacts of a sphere on a layer of rocks.

A `LabCase` says what is packed and fired, `run_impacts` fires it, `fit_impacts` makes sets of it,
`fit_contacts` makes them of measured contacts, `scorecard` sets them beside what is known.
"""
