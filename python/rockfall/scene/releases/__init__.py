# SPDX-License-Identifier: BSD-3-Clause
"""Sources, and the boulders that they release."""
