# SPDX-License-Identifier: BSD-3-Clause
"""Report of a result as an HTML page that works offline; `page` writes it."""
