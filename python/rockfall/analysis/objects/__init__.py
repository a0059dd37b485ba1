# SPDX-License-Identifier: BSD-3-Clause
"""Objects at risk: boulders that hit houses and road segments, and the resulting risk."""
