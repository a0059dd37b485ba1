# SPDX-License-Identifier: BSD-3-Clause
"""Trees for the kernel, from a list or generated from stem densities."""
