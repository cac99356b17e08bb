"""The web application: it stores, authorises, hands out and serves; it computes nothing."""

import service.platform.garbage  # noqa: F401  # before everything else
