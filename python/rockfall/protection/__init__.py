# SPDX-License-Identifier: BSD-3-Clause
"""Protection: performance and requirements of barriers."""
