# SPDX-License-Identifier: BSD-3-Clause
"""How boulders do on planes: the slope above which they get faster."""
