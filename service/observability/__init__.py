"""What the service tells its operator: one id through everything that a request causes, logs, figures."""
