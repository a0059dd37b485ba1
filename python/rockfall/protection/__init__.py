# SPDX-License-Identifier: BSD-3-Clause
"""Protection: what barriers did, and what a barrier must be."""
