"""The service's reports to its operator: one id through everything that a request causes, logs, figures."""

import sys
from typing import Any

# structlog imports rich, if it is installed, to print coloured tracebacks. Nothing here needs these, and rich takes a
# twentieth of a process's start.
if "rich" not in sys.modules:
    _modules: dict[str, Any] = sys.modules
    _modules["rich"] = None
    import structlog  # noqa: F401

    del sys.modules["rich"]
