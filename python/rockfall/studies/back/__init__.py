# SPDX-License-Identifier: BSD-3-Clause
"""Back-analysis: uncertain inputs inferred from observations."""
