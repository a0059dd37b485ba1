# SPDX-License-Identifier: BSD-3-Clause
"""Motion of boulders on planes: the slope above which they accelerate."""
