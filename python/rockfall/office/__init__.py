# SPDX-License-Identifier: BSD-3-Clause
"""Tables of a result and of a design as a workbook (.xlsx) and as a document (.docx)."""
