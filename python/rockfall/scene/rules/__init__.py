# SPDX-License-Identifier: BSD-3-Clause
"""What inputs hardly ever mean, by what they are about."""
