# SPDX-License-Identifier: BSD-3-Clause
"""Import of projects of PlatRock and AvaFrame as cases (docs/other_programs.md)."""
