# SPDX-License-Identifier: BSD-3-Clause
"""From a case and its files to the arrays that the kernel takes."""
