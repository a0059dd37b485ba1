# SPDX-License-Identifier: BSD-3-Clause
"""Hazard and risk from scenarios with annual frequencies: maps, zones, objects (docs/hazard.md)."""
