# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets fitted to impacts, of the laboratory or measured, and their files."""
