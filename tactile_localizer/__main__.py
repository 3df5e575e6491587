"""``python -m tactile_localizer``: the ``tactile-localizer`` command."""

import sys

from tactile_localizer.cli import main

sys.exit(main())
