# SPDX-License-Identifier: BSD-3-Clause
"""Sources, and what is released from them."""
