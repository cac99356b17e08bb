"""What the service tells its operator: one id through everything that a request causes, logs, figures."""

import sys
from typing import Any

# structlog imports rich where it finds it, to print coloured tracebacks, which nothing here asks for. Rich is a
# twentieth of a process's start.
if "rich" not in sys.modules:
    _modules: dict[str, Any] = sys.modules
    _modules["rich"] = None
    import structlog  # noqa: F401

    del sys.modules["rich"]
