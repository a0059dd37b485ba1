# SPDX-License-Identifier: BSD-3-Clause
"""`python -m rockfall` is the command `rockfall`."""

import sys

from rockfall.cli import main

sys.exit(main())
