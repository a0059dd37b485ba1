# SPDX-License-Identifier: BSD-3-Clause
"""Studies: several runs of a case with different scenes, and conclusions from them."""
