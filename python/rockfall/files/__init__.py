# SPDX-License-Identifier: BSD-3-Clause
"""Results and hazards as files for GIS, CAD, spreadsheets and virtual globes."""
