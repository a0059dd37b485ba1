# SPDX-License-Identifier: BSD-3-Clause
"""`python -m rockfall.cli`, as job scripts call it: the same Python, whatever is on PATH."""

import sys

from rockfall.cli import main

sys.exit(main())
