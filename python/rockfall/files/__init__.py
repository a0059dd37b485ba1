# SPDX-License-Identifier: BSD-3-Clause
"""Results and hazards as files for a GIS, CAD, spreadsheets and viewers of the Earth."""
