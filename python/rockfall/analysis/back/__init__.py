# SPDX-License-Identifier: BSD-3-Clause
"""Back-analysis: which uncertain inputs make what was observed likely."""
