# SPDX-License-Identifier: BSD-3-Clause
"""Objects at risk: boulder hits on houses and road segments, and the resulting risk."""
