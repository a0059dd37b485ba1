# SPDX-License-Identifier: BSD-3-Clause
"""Hazard and risk: from scenarios with frequencies to maps, zones and objects (docs/hazard.md)."""
