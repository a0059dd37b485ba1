# SPDX-License-Identifier: BSD-3-Clause
"""Objects at risk: houses and segments of roads, what hits them, and the resulting risk."""
