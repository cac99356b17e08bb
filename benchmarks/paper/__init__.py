"""The paper's two recordings, simulated, beside the errors that it reports."""
