# SPDX-License-Identifier: BSD-3-Clause
"""Report of a result as one HTML page that needs no network: `page` writes it."""
