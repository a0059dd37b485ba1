# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets fitted to simulated or measured impacts, and their files."""
