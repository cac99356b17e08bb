"""What goes over the broker: hints for browsers, and how a connection to it waits."""
