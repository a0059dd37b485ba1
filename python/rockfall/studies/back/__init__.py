# SPDX-License-Identifier: BSD-3-Clause
"""Back-analysis: the uncertain inputs that make the observations likely."""
