# SPDX-License-Identifier: BSD-3-Clause
"""Tables of a result or design as a workbook (.xlsx) and a document (.docx)."""
