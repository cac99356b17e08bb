"""The web application: it stores, authorises, hands out and serves; it computes nothing."""
