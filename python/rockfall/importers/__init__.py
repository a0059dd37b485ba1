# SPDX-License-Identifier: BSD-3-Clause
"""Import of PlatRock and AvaFrame projects as cases (docs/other_programs.md)."""
