# SPDX-License-Identifier: BSD-3-Clause
"""The command line: arguments in, exit status out."""

from rockfall.cli.command_line import main as main
